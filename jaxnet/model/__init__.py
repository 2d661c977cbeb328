"""One lane's physics: pure functions on one fleet, no batch axis, no randomness, no I/O.

The terms of the closed loop, a file each: `graph`, `navigator`, `robot`, `attack`, `defence`, `control`;
`definition` holds the law as the paper stacks it, and `lane` the whole of one simulated fleet.

Vehicles are numbered 1..m as in the paper and the navigator is 0. A *source* is whatever a vehicle may
hear: an array over sources has m + 1 entries, the navigator first, so that source j stands at index j;
an array over vehicles has m entries, vehicle i at index i - 1.
"""
