"""Physics of the closed loop: pure functions, no I/O. Random numbers follow from keys (`chance`).

The modules follow a message through the loop:

- `graph`: links and weights of the network, settled before the run.
- `hearing`: the message that each listener receives over each link.
- `retained`: the sources that a vehicle retains, and the weights in force.
- `signal`: the signal that an attack adds.
- `control`: the control law, solved by structure.
- `lane`: the numbers of one simulated fleet.

Vehicles have the numbers 1 to m as in the paper, and the navigator has the number 0. A *source* is
the navigator or a vehicle. An array over sources has m + 1 entries, and source j stands at index j.
An array over vehicles has m entries, and vehicle i stands at index i - 1. The lane axis is the last
axis.
"""
