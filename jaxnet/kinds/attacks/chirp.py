import numpy as np

from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.attacks.rotating import turned
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, setting
from jaxnet.model.circle import circle


class Chirp(Attack):
    """`[cos, sin](ψ(t) + phase)` with ψ' = frequency + rate · t: a rotation that grows faster or
    slower.
    """

    highest = 4

    frequency: PerVehicle = setting(0.2, "[rad/s], of the turning at t = 0")
    rate: PerVehicle = setting(0.05, "[rad/s²], by which the frequency grows")
    phase: Angle = setting(FULL_TURN, "[rad], at t = 0")

    def basis(self, time):
        """Cos ψ and sin ψ. With z = e^{iψ}: z' = iωz, z'' = (ir - ω²)z, z‴ = -(3rω + iω³)z."""
        xp = time.__array_namespace__()
        w, r = (self.frequency + self.rate * time)[None], self.rate[None]
        now = xp.stack(circle(self.frequency * time + self.rate * time**2 / 2))
        ahead = xp.stack([-now[1], now[0]])
        return xp.stack([now, w * ahead, r * ahead - w**2 * now, -3 * r * w * now - w**3 * ahead])

    def vectors(self):
        return turned(self.phase)

    def sizes(self, horizon):
        """1, ω, √(r² + ω⁴), ω √(9r² + ω⁴), √((ω⁴ - 3r²)² + 36r²ω⁴) with the greatest ω = |ψ'|.

        It is at one end of [0, horizon].
        """
        first, rate = np.asarray(self.frequency), np.asarray(self.rate)
        w = np.maximum(np.abs(first), np.abs(first + rate * horizon))
        third, fourth = w * np.hypot(3 * rate, w**2), np.hypot(w**4 - 3 * rate**2, 6 * rate * w**2)
        return np.stack([np.ones_like(w), w, np.hypot(rate, w**2), third, fourth])
