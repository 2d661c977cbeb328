"""Errors of messages that liars know, for acting_knows.yaml."""

import jax.numpy as jnp

from jaxnet.kinds.noises.gaussian import GaussianNoise


class Known(GaussianNoise):
    """Normal errors of messages, but none of those of liars.

    A liar that knows the error of its message subtracts it, so listeners get just what it wants.
    """

    words = "known to liars"

    liars: list[int]

    def tells_deviations(self):
        """Detectors count on the errors of honest messages."""
        return True

    def next_errors(self, last, time, interval, sources):
        known = jnp.isin(sources, jnp.array(self.liars))[None, ..., None]
        errors = super().next_errors(last, time, interval, sources)
        return tuple(jnp.where(known, 0.0, each) for each in errors)
