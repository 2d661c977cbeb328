"""What serves large fleets alone: windows of a Laplacian, and shorter steps for a few vehicles.

`windowed` solves `L x = b` again only near the vehicles that decide otherwise (exact engine). `multirate`
lets a few vehicles of a fleet take shorter steps (nonlinear engine). Nothing else depends on this room.
"""
