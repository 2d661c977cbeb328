"""Methods for large fleets alone: windows of a Laplacian, and shorter steps for a few vehicles.

`windowed` solves `L x = b` again only near the vehicles whose decisions change (exact engine). `multirate`
lets a few vehicles of a fleet take shorter steps (nonlinear engine). Only these two engines import this
folder.
"""
