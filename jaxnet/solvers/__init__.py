"""Solvers of `L x = b`, `L = I - A` with the weights in force. `choice` picks one for a graph.

L is a row diagonally dominant M-matrix. Elimination therefore needs no pivot search. Retained
sources are a subset of the sources that a vehicle hears. One solver therefore serves all lanes and
ticks of a graph.

The navigator reaches every vehicle over the weights in force if and only if `L⁻¹ a0 = 1`. The
residual of a solver is the distance of `L⁻¹ a0` from 1. It is of the order of rounding if the graph
is connected. It is of order 1 or NaN if a vehicle is cut off. For `Iterative`, the residual is a
bound on the error, infinite if a vehicle is cut off.
"""
