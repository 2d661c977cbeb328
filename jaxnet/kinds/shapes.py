"""Shapes of arrays that methods of kinds take and return, for NumPy and JAX. Lanes are last.

m is the number of vehicles, a slot is one source of a listener, B counts scalar functions.
"""

from typing import Annotated, Any

from jaxtyping import Bool, Float, Int, Shaped

LaneTimes = Float[Any, "*lanes"]  # [s]
LaneNumbers = Float[Any, "*lanes"]
AnyTimes = Float[Any, "..."]  # [s], of any shape

SignalBasis = Float[Any, "derivatives functions ..."]  # β_b and three derivatives, or four
# v_b of each vehicle; the second axis is 1 if all are alike
SignalVectors = Float[Any, "2 _ functions ..."]
# Greatest norm of β and of its derivatives, three or four
SignalSizes = Float[Any, "derivatives _"]

AnyNumbers = Float[Any, "..."]
PlaneVectors = Float[Any, "2 ..."]
NumberJets = Float[Any, "derivatives ..."]  # a number and three derivatives, or four
PathJets = Float[Any, "4 2 ..."]  # position and three derivatives
VehicleVectors = Float[Any, "2 m *lanes"]
VehicleNumbers = Float[Any, "m *lanes"]
VehicleMask = Bool[Any, "m *lanes"]
VehicleJets = tuple[VehicleVectors, ...]  # position, velocity, …: as many as the order
StackedJets = Float[Any, "r 2 m *lanes"]  # those of `VehicleJets` as one array
VehicleState = Float[Any, "n m *lanes"]
InnerState = Float[Any, "k m *lanes"]  # states that the output's jets leave open
VehicleInput = Float[Any, "2 m *lanes"]
AxisMatrices = Float[Any, "2 2 m *lanes"]  # by axis and column

SlotVectors = Float[Any, "2 slots m *lanes"]
SlotNumbers = Float[Any, "slots m *lanes"]
SlotMask = Bool[Any, "slots m *lanes"]
SlotSources = Int[Any, "slots m"]  # numbers of the sources, 0 is the navigator
SlotLinks = Bool[Any, "slots m"]  # the same in all lanes
HeldErrors = tuple[Float[Any, "2 ..."], ...]
SlotJets = tuple[SlotVectors, ...]  # position, velocity, acceleration
AxisSlotNumbers = Float[Any, "axes slots m *lanes"]
AxisSlotMask = Bool[Any, "2 slots m *lanes"]
LaneGains = Float[Any, "r 2 2 *lanes"] | Float[Any, "r *lanes"]  # of ε and its derivatives
AnyCounts = Int[Any, "..."]
AnyMask = Bool[Any, "..."]
Decision = Shaped[Any, "..."]  # (slots, m, lanes), or (2, slots, m, lanes) to decide by axis

# A pytree of arrays whose last axis is lanes; a kind chooses its structure
Memory = Annotated[Any, "memory"]
