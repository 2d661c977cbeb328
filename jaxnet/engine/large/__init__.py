"""Methods for large fleets alone: windows of a Laplacian, and shorter steps for a few vehicles.

`windowed` updates the solution of `L x = b` near the vehicles that change their decision (exact engine).
`multirate` lets a few vehicles of a fleet take shorter steps (nonlinear engine). No other engine imports this
folder.
"""
