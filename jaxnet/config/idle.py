"""Keys that a config gives and that change nothing, for `jaxnet check`: a table of rules, one a line."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from pydantic import BaseModel

from jaxnet.config.faults import is_multiple
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.scenario import links_of
from jaxnet.config.study import Study
from jaxnet.kinds.attacks import usual_targets
from jaxnet.kinds.fields import is_drawn, value_range
from jaxnet.kinds.noise import HIGHEST, JET_ORDERS, ErrorsAtTicks
from jaxnet.model.wording import ranges

DEFAULTS = Scenario()
LinkWeights = dict[tuple[int, int], float]  # weights by listener, from 0, and source
ANNOUNCED = "the defence has nobody announce: give score: announced"


class IdleRule(NamedTuple):
    """Keys, when they change nothing, and why."""

    keys: tuple[str, ...]
    idle: Callable[[Scenario], bool]
    why: str


def exact(errors: ErrorsAtTicks) -> bool:
    """Return whether all standard deviations are 0."""
    return not any(getattr(errors, order, 0) for order in (*JET_ORDERS, HIGHEST))


def misses_ticks(key: str) -> Callable[[Scenario], bool]:
    """Return whether the time at a key is between two ticks."""

    def idle(scenario: Scenario) -> bool:
        _, time = found(scenario, key)
        times = time if isinstance(time, list) else [value_range(time)[0]]
        return (
            not is_drawn(time)
            and scenario.tick > 0
            and not all(is_multiple(t, scenario.tick) for t in times)
        )

    return idle


PERIODS = ("topology.every", "topology.at", "channel.loss.period", "channel.loss.length")
RULES = (
    IdleRule(
        ("channel.extrapolate",),
        lambda s: not s.channel.late,
        "no word is late: give channel.delay",
    ),
    IdleRule(("channel.delay_of",), lambda s: not is_drawn(s.channel.delay), "no delay is drawn"),
    IdleRule(
        ("channel.missing",),
        lambda s: s.channel.loss.perfect() and not s.channel.late,
        "no message is lost: give channel.loss",
    ),
    *(
        IdleRule(
            tuple(f"{at}.{key}" for key in ("outliers", "outlier_factor", "correlation", "of")),
            lambda s, of=of: exact(of(s)),
            "there are no errors: give a standard deviation, as position",
        )
        for at, of in {
            "channel.noise": lambda s: s.channel.noise,
            "sensing": lambda s: s.sensing,
        }.items()
    ),
    IdleRule(("attack.announces",), lambda s: not s.defence.announcing(), ANNOUNCED),
    IdleRule(("defence.first_announcement",), lambda s: not s.defence.announcing(), ANNOUNCED),
    IdleRule(
        ("defence.isolated",),
        lambda s: not s.law.couples(),
        "under a local law no vehicle has a drive to keep",
    ),
    IdleRule(
        ("topology.navigator", "topology.navigator_weight"),
        lambda s: not s.navigator.present,
        "there is no navigator",
    ),
    *(
        IdleRule(
            (key,), misses_ticks(key), "it is no multiple of tick: it acts from the next tick on"
        )
        for key in PERIODS
    ),
)


def found(holder: BaseModel, key: str) -> tuple[bool, object]:
    """Return whether a dotted key has another value than its default, and the value, None without the key."""
    value: object = holder
    given = False
    for part in key.split("."):
        fields = type(value).model_fields if isinstance(value, BaseModel) else {}
        if part not in fields:
            return False, None
        default, value = fields[part].default, getattr(value, part)
        given = value != default
    return given, value


def idle_keys(study: Study) -> dict[str, str]:
    """Return why a key that is given changes nothing in any cell that gives it, by key."""
    reasons: dict[str, list[str]] = {}
    links: dict[tuple[int, ...], LinkWeights] = {}
    for cell in study.cells:
        for key, why in idle_in(cell.scenario, links):
            reasons.setdefault(key, []).append(why)
    told = {key: whys[0] for key, whys in reasons.items() if all(whys)} | dict(
        replaced_keys(study.config)
    )
    search, horizon = study.config.search, min(cell.scenario.horizon for cell in study.cells)
    if search is not None and search.until < horizon:
        told["search.until"] = f"choices are run to the horizon of {horizon:g} s, which is later"
    return told


def idle_in(
    scenario: Scenario, links: dict[tuple[int, ...], LinkWeights]
) -> Iterator[tuple[str, str]]:
    """Yield each key that a cell gives and a rule knows, and why it changes nothing, "" if it acts.

    `links` keeps the links of the networks of other cells.
    """
    for rule in RULES:
        for key in rule.keys:
            if found(scenario, key)[0]:
                yield key, rule.why if rule.idle(scenario) else ""
    trusted = getattr(scenario.defence, "trusted", None)
    if not (isinstance(trusted, dict) and trusted):
        return
    by = (
        id(scenario.topology),
        id(scenario.navigator),
        scenario.vehicles,
    )  # objects that the cells hold
    if by not in links:
        links[by] = links_of(scenario).pairs()
    for listener, sources in trusted.items():
        unheard = [source for source in sources if (listener - 1, source) not in links[by]]
        yield (
            f"defence.trusted.{listener}",
            f"{listener} does not hear {ranges(unheard)}" * bool(unheard),
        )


def replaced_keys(config: Config) -> Iterator[tuple[str, str]]:
    """Yield the keys outside the sweep that a swept key replaces."""
    for swept in config.sweep:
        value, keys = getattr(config, swept, None), [swept]
        if isinstance(value, BaseModel):
            keys = [f"{swept}.{key}" for key in type(value).model_fields]
            if type(value) is not type(getattr(DEFAULTS, swept)):
                yield f"{swept}.kind", f"sweep.{swept} replaces the whole {swept}"
        for key in keys:
            given, base = found(config, key)
            if given and not (key == "attack.vehicles" and base == usual_targets(config.vehicles)):
                yield (
                    key,
                    f"sweep.{swept} replaces " + (f"the whole {swept}" if key != swept else "it"),
                )
