"""Shapes of arrays that several modules of the physics share, for NumPy and JAX."""

from collections.abc import Sequence
from typing import Any

from jaxtyping import Bool, Float, Int, Shaped

Numbers = Float[Any, "..."]
Flags = Bool[Any, "..."]
PlaneArray = Float[Any, "2 ..."]
OrderedJets = Sequence[Numbers] | Numbers  # a signal and derivatives, one by one or as one array
LoopIndex = Int[Any, ""]  # number of a loop's pass, or an index
RetainedSlots = Shaped[Any, "..."]  # ([axes,] slots, m, lanes); booleans or weights
