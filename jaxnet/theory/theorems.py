"""All theorems that `jaxnet check` asks; a theorem more is a line here and its module."""

from jaxnet.theory import announced, certificate, delay, exact, noise, rounds, safe, tolerance

THEOREMS = (
    certificate.INVERSE_NORM,
    certificate.HONEST_PATHS,
    certificate.CUT_OFF,
    certificate.REACH,
    certificate.NOMINAL,
    *tolerance.ROBUSTNESSES,
    *noise.STEADY_ERRORS,
    *rounds.STABILITIES,
    *delay.LATE_FLEETS,
    safe.SAFE,
    safe.PROOF_ENDS,
    announced.THEOREM_3,
    exact.DECAY,
)
