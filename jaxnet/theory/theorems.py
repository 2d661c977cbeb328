"""All theorems that `jaxnet check` asks: where proved, what they tell, what they need.

A theorem more is a line in THEOREMS, a function of a `Case`, and what its value says in words in
PHRASES of `view/text/facts.py`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxnet.config.scenario import MOTION, missing
from jaxnet.theory import (
    alarms,
    announced,
    certificate,
    delay,
    misjudged,
    noise,
    rounds,
    safe,
    solution,
    tolerance,
)
from jaxnet.theory.case import Case
from jaxnet.theory.clipping import never_global, unclipped
from jaxnet.theory.start import keeps_moving, start_decay, start_drive


class Theorem(NamedTuple):
    """A result and its premises."""

    name: str  # where it is proved: O12 of docs/theorems.md, theorem 3 of docs/guarantees.md
    quantity: str  # what it tells
    needs: tuple[str, ...]  # names of premises (`jaxnet.config.scenario.PREMISES`)
    value: Callable[[Case], Any]  # None where the theorem tells nothing


AT_LAST = ("leader", *MOTION)
AS_ASKED = ("flat", "unfiltered", "uncut", "continuous")
OF_LINKS = ("leader", "same links")
LIVE = (*AS_ASKED, "one network", "same links", "every message", "on time")
OF_LAWS = ("one gain", *LIVE, "unheld", "small")
OF_HELD_LAWS = tuple(each for each in OF_LAWS if each != "continuous")
OF_ERRORS = ("solved", "one gain", "alike", *LIVE, "unrounded messages", "ticks")
OF_DELAY = (*AS_ASKED, "one network", "same links", "every message", "no decisions")
OF_DELAY += ("steady delay", "small")
MEAN_SQUARE = ("one gain", *AS_ASKED, "one network", "same links", "on time", "drops")
MEAN_SQUARE += ("no decisions", "small")
WHILE_REACHED = (*OF_LINKS, "solved", *AS_ASKED, "one network", "on time", "drops")
# Of vehicles that move as asked while they are not clipped, and do not stop
WITHIN = ("one gain", *(each for each in AT_LAST if each != "flat"))
IN_TURNS = (*OF_LINKS, "small", "solved", *AS_ASKED)
# Until an alarm cuts something
OF_ALARMS = ("white", "unrounded messages", "every message", "on time", "foretold", "ticks")
OF_CUTS = (*OF_LINKS, "one network", "no decisions", "small")
OF_LIES = (*OF_ALARMS, *OF_CUTS, "flat", "unfiltered", "continuous", "solved", "one gain", "alike")
OF_LIES += ("one identity", "by law")
OF_SEPARATION = ("flat", "filtered", "true places")


START = Theorem("O1", "start", AT_LAST, start_decay)

THEOREMS = (
    Theorem("O5", "inverse norm", OF_LINKS, certificate.inverse_norm_of),
    Theorem("Assumption 1", "honest paths", OF_LINKS, certificate.honest_paths),
    Theorem("O11", "cut off", OF_LINKS, certificate.droppable),
    Theorem("O1", "reach", (*OF_LINKS, "small"), certificate.reach_in_turns),
    Theorem("O1", "nominal", IN_TURNS, certificate.nominal_in_turns),
    Theorem("O9", "alone", ("same links",), tolerance.alone),
    Theorem("O9", "agreement", (), tolerance.agreement),
    Theorem("O13", "sensors leave", OF_ERRORS, noise.of_sensors),
    Theorem("O15", "messages leave", (*OF_ERRORS, "no decisions", "small"), noise.of_messages),
    Theorem("O19", "runs", OF_ALARMS, alarms.alarm_runs),
    Theorem("O19", "unseen lie", OF_ALARMS, alarms.unseen_lie),
    Theorem("O19", "unseen effect", OF_LIES, alarms.unseen_effect),
    Theorem("Menger 1927", "isolation", OF_CUTS, certificate.isolation),
    Theorem("O12", "stability", OF_HELD_LAWS, rounds.stability),
    Theorem("O12", "in mean square", MEAN_SQUARE, rounds.in_mean_square),
    Theorem("O1", "while reached", WHILE_REACHED, rounds.reached_at_ticks),
    Theorem("O16", "lag", (*OF_DELAY, "solved"), delay.lag_behind),
    Theorem("O16", "follows lines", (*OF_DELAY, "solved"), delay.follows_lines),
    Theorem("O16", "greatest delay", (*OF_DELAY, "solved", "one gain"), delay.greatest_delay),
    Theorem("O16", "growth when late", (*OF_DELAY, "one gain"), delay.growth_when_late),
    Theorem("Yemini et al. 2022", "misjudged", ("same links",), misjudged.misjudged),
    Theorem("Olfati-Saber 2004", "common margin", (*OF_DELAY, "one gain"), delay.common_margin),
    Theorem("O11", "safe", AT_LAST, safe.safe_vehicles),
    Theorem("O11", "proof ends", AT_LAST, safe.proof_ends),
    Theorem("theorem 3", "ultimate error", (*AT_LAST, "consistent"), announced.ultimate),
    Theorem("Lemma 1", "decay", AT_LAST, solution.decay),
    Theorem("O18", "apart", OF_SEPARATION, lambda case: case.scenario.filter.keeps(case.scenario)),
    START,
    Theorem("O1", "start drive", ("leader", "solved", "flat", "one gain"), start_drive),
    Theorem("O1", "keeps moving", WITHIN, keeps_moving),
    Theorem("Sussmann and Yang 1991", "never global", (), never_global),
    Theorem("O1", "unclipped", WITHIN, unclipped),
)


def values(case: Case) -> dict[str, Any]:
    """What theorems tell of a case whose premises it has, by quantity."""
    able = [each for each in THEOREMS if not missing(case.scenario, each.needs)]
    found = {each.quantity: each.value(case) for each in able}
    return {quantity: value for quantity, value in found.items() if value is not None}


def errors_leave(case: Case) -> float:
    """Mean error of the fleet [m] that normal errors of sensors and messages leave at last.

    A vector whose two axes have the standard deviation σ has the mean length `σ √(π / 2)`. 0 if
    nothing is known.
    """
    of_errors = [each for each in THEOREMS if each.quantity in ("sensors leave", "messages leave")]
    able = [each for each in of_errors if not missing(case.scenario, each.needs)]
    known = [rms for rms in (each.value(case) for each in able) if rms is not None]
    return float(np.sqrt(np.pi / 2 * sum(np.square(rms) for rms in known)).mean())
