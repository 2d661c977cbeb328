"""Ways to advance lanes from tick to tick, and what is measured on the way.

receive → decide → follow → measure: at each tick every vehicle receives what its sources send and decides
whom to retain (`tick`), at output times the fleet is measured (`metrics`). Between ticks the vehicles move:
`propagation` solves the closed loop exactly, `integration` steps the nonlinear vehicles (with `stepper`,
`multirate` and `queue`); `methods` are the engines that a config chooses between. `batch` runs many lanes at
once.
"""
