"""The law that the paper argues against: feedback of the error, linearised about the navigator."""

from jaxnet.kinds.kind import Fault
from jaxnet.kinds.laws import Law


class LinearisedLaw(Law):
    """`u_i = u_0 + K e_i`: inputs linear in the error of the state (paper, section 3.3), for
    comparison.

    A vehicle takes the mean of its neighbours' states and inputs in place of the navigator's: `u_i
    = Σ_j w_ij u_j + K (x_i - Σ_j w_ij x_j)`, with the weights in force. Components in radians
    differ by at most half a turn. K(t) is the derivative of the exact law's inputs with respect to
    the state, at the navigator's state and inputs. The linearised closed loop therefore has the
    poles of `gain`. Without attack the means cancel, as under the exact law, and `u_i = u_0 + K
    (x_i - x_0)`. An attack `a_ij` shifts states and inputs by the linearisation of its jets.

    The law works near the navigator alone. Vehicles may stand still and drive backwards. `dopri5`
    runs in place of `gauss`. Only the nonlinear engine knows the law; no message may be lost, and
    `isolated` is `fail`.
    """

    holds = False

    def way(self):
        return "linearised"

    def faults(self, scenario):
        yield from super().faults(scenario)
        if scenario.defence.coasts():
            message = f"{self.kind} knows no drive that a vehicle could keep: give isolated: fail"
            yield Fault(("defence", "law"), message)
        if scenario.vehicle.internal:
            message = "needs the navigator's state, which its path does not determine for"
            yield Fault(("law", "vehicle"), f"{self.kind} {message} {scenario.vehicle.kind}")
