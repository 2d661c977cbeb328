"""The physics of the closed loop: pure functions, no randomness, no I/O.

`graph` and `hearing` say who receives what from whom, `retained` whom a vehicle retains of them, `signal`
what an attack adds; `control` is the law, solved by structure, and `definition` the same as the paper stacks
it; `lane` holds one simulated fleet.

Vehicles are numbered 1..m as in the paper and the navigator is 0. A *source* is whatever a vehicle may
hear: an array over sources has m + 1 entries, the navigator first, so that source j stands at index j;
an array over vehicles has m entries, vehicle i at index i - 1. Lanes, where there are any, are the last axis.
"""
