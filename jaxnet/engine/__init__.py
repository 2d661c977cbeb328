"""One loop that advances lanes, and what differs between engines.

At each tick vehicles sense, tell, receive and decide (`tick`), at output times the fleet is measured
(`metrics`), and `loop` owns both. Between ticks the vehicles move: `propagation` solves the closed loop
exactly, `integration` steps the nonlinear vehicles (with `stepper` and `multirate`). `methods` are the
engines that a config chooses between. `batch` runs many lanes at once.
"""
