"""One loop that advances lanes, and the engines, which differ in how vehicles move between ticks.

At each tick vehicles tell, receive and decide (`tick`). At output times `metrics` measures the
fleet. `loop` calls both. Between ticks the vehicles move: `propagation` solves the closed loop
exactly, and `integration` steps the nonlinear vehicles (with `stepper`). `methods` contains the
engines that a config chooses from. `batch` runs many lanes at once.
"""
