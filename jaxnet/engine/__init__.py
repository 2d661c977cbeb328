"""Ways to advance a lane from tick to tick, and what is measured on the way.

hear → decide → measure → advance: at each tick every vehicle hears its sources and decides whom to keep
(`chassis.decide`), at output times the fleet is measured (`metrics`), between ticks the robots move
(`chassis`, which steps with `stepper`). `batch` runs many lanes at once.
"""
