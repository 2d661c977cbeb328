"""What a liar announces where the defence judges announcements (theorems.md O11, assumption B1)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxnet.config.scenario import safe_in, situation_of
from jaxnet.view.text import check
from tests import systems

ANNOUNCED = {"kind": "trusted_trim", "score": "announced"}
SIGNALS = {"constant": {"kind": "bias"}, "rotating": {"kind": "rotating", "frequency": 0.7}}


def ring(announces, signal="constant", **defence):
    """The paper's ring, four attacked vehicles, ā = 8 m."""
    attack = {**SIGNALS[signal], "magnitude": 8.0, "announces": announces}
    keys = {"engine": "exact", "horizon": 60.0, "output_step": 0.5}
    return systems.study(attack=attack, defence=ANNOUNCED | defence, **keys)


def ends(study, samples=50):
    """Greatest tail error of a vehicle per ā, of each lane."""
    outcome = systems.simulated(systems.lanes(study, samples, ()))
    assert (outcome.status == 0).all()
    return outcome.metrics["tail_max"] / study.config.attack.magnitude


def certificate(study):
    scenario = study.cells[0].scenario
    known = situation_of(scenario)
    reasons = safe_in(scenario, known.graph, known.attacked)
    safe = ((each.why.partition(",")[0], np.flatnonzero(each.vehicles) + 1) for each in reasons)
    return {why: vehicles.tolist() for why, vehicles in safe}


@pytest.mark.parametrize("signal", SIGNALS)
def test_a_liar_that_announces_nothing_is_believed_in_every_lane(signal):
    """Each listener drops its honest neighbour: γ = w (1 + w γ) with w = 0.45/0.55, γ = 2.475."""
    assert np.allclose(ends(ring("zero", signal)), 2.475, atol=1e-9)


def test_consistent_announcements_expose_the_liar_from_any_first_announcement():
    """Theorem 3 with Λ = 0: nothing is left of a constant attack."""
    for first in (1.0, 100.0):
        assert ends(ring("consistent", first_announcement=first)).max() < 1e-9


def test_free_announcements_are_those_asked_for():
    """`s [cos, sin](ω t + φ)` on attacked links, what the source announces on the others."""
    free = {"kind": "free", "size": [1.0, 2.0], "frequency": 3.0, "phase": {"each": 0.5}}
    attack = {"kind": "bias", "vehicles": [2, 5], "announces": free}
    study = systems.study(engine="exact", attack=attack, defence=ANNOUNCED)
    job = systems.lanes(study, 1, ())
    announces, (sources, _, attacked, signals) = job.inputs.lane.announces, job.network.hearing
    numbers = {key: vars(announces)[key].T for key in ("size", "frequency", "phase")}
    drawn = type(announces).filled(numbers)
    honest = np.random.default_rng(0).normal(size=(2, *sources.shape, 1))
    nothing = np.full_like(honest, np.nan)
    told = drawn.received(honest, nothing, attacked[..., None], signals, np.array([0.25]))
    angle = 3.0 * 0.25 + 0.5
    for source, size in ((2, 1.0), (5, 2.0)):
        here = told[:, attacked & (sources == source), 0]
        assert here.size == 4
        assert np.allclose(here.T, size * np.array([np.cos(angle), np.sin(angle)]))
    assert (told[:, ~attacked] == honest[:, ~attacked]).all()


def test_certificates_that_rest_on_what_a_liar_announces_say_so():
    """Who is safe by majority is so if attacked links announce what they carry, and no longer."""
    assert certificate(ring("consistent"))["by majority"] == [*range(1, 13)]
    text = " ".join(check.check_text(ring("consistent")).split())
    assert "assumed: attacked links announce what they carry" in text
    assert "if no vehicle stands still or is cut off" in text
    for announces in ("zero", "honest", "free"):
        study = ring(announces)
        assert "by majority" not in certificate(study)
        assert f"broken: attacked links announce {announces}" in check.check_text(study)


def test_announcements_are_overheard_with_noise_but_the_navigators():
    """Standard deviation as asked on each axis, independent of noise on positions; 0 stays 0."""
    study = ring("consistent", noise=2.0)
    defence = systems.lanes(study, 1, ()).inputs.lane.defence
    numbers = {"noise": jnp.array([2.0]), "key": jnp.array([0.3])}
    drawn = type(defence).filled({**vars(defence), **numbers})
    sources = np.tile(np.array([0, 1, 2]), (4000, 1)).T
    told = jnp.zeros((2, *sources.shape, 1))
    overheard = np.asarray(jax.jit(drawn.overheard)(told, sources, jnp.array([0.5])))
    assert (overheard[:, 0] == 0).all()
    assert overheard[:, 1:].std() == pytest.approx(2.0, rel=0.03)
    seen = np.asarray(jax.jit(drawn.judges_by)((told,), jnp.array([0.5]))[0])
    assert abs(np.corrcoef(seen[:, 1:].ravel(), overheard[:, 1:].ravel())[0, 1]) < 0.05
