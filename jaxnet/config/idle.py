"""Keys that a config gives and that change nothing, for `jaxnet check`."""

from collections.abc import Iterator

from pydantic import BaseModel

from jaxnet.config.faults import is_multiple
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.scenario import but_signal, links_of
from jaxnet.config.study import Study
from jaxnet.kinds.attacks import usual_targets
from jaxnet.kinds.fields import is_drawn, value_range
from jaxnet.kinds.ticks import HIGHEST, JET_ORDERS
from jaxnet.model.wording import ranges

DEFAULTS = Scenario()
KEYS_OF_ERRORS = ("outliers", "outlier_factor", "correlation", "of")
PERIODS = ("topology.every", "topology.at", "channel.loss.period", "channel.loss.length")


def rules(s: Scenario) -> Iterator[tuple[str, bool, str]]:
    """Yield a key, whether it changes nothing in a cell, and why."""
    late, announces = s.channel.late, s.defence.announcing()
    yield "channel.extrapolate", not late, "no message is delayed: give channel.delay"
    yield "channel.own_delay", not late, "no message is delayed: give channel.delay"
    yield "channel.delay_of", not is_drawn(s.channel.delay), "no delay is drawn"
    lossless = s.channel.loss.perfect() and not (late or s.detector.acts)
    yield "channel.missing", lossless, "no message is lost: give channel.loss"
    for at, errors in {"channel.noise": s.channel.noise, "sensing": s.sensing}.items():
        exact = not any(getattr(errors, order, 0) for order in (*JET_ORDERS, HIGHEST))
        for key in KEYS_OF_ERRORS:
            why = "there are no errors: give a standard deviation, as position"
            yield f"{at}.{key}", exact, why
    for key in ("attack.announces", "defence.first_announcement"):
        yield key, not announces, "no vehicle announces under this defence: give score: announced"
    cut = "no alarm cuts a link: give detector.cuts: link or both_ways"
    yield "detector.return_after", not s.detector.cuts_links, cut
    why = "under a local law no vehicle has a drive to keep"
    yield "defence.isolated", not s.law.couples(), why
    for key in ("topology.navigator", "topology.navigator_weight"):
        yield key, not s.navigator.present, "there is no navigator"
    for key in PERIODS:
        why = "it is no multiple of tick: it acts from the next tick on"
        yield key, misses_ticks(given(s, key)[1], s.tick), why


def misses_ticks(time: object, tick: float) -> bool:
    if time is None or tick == 0 or is_drawn(time):
        return False
    times = time if isinstance(time, list) else [value_range(time)[0]]
    return not all(is_multiple(each, tick) for each in times)


def given(holder: BaseModel, key: str) -> tuple[bool, object]:
    """Return whether a dotted key has another value than its default, and the value."""
    value: object = holder
    differs = False
    for part in key.split("."):
        fields = type(value).model_fields if isinstance(value, BaseModel) else {}
        if part not in fields:
            return False, None
        default, value = fields[part].default, getattr(value, part)
        differs = value != default
    return differs, value


def idle_keys(study: Study) -> dict[str, str]:
    """Return why a key that is given changes nothing in any cell that gives it, by key."""
    reasons: dict[str, list[str]] = {}
    different = dict.fromkeys(but_signal(cell.scenario) for cell in study.cells)
    for scenario in (each.one for each in different):
        rows = [row for row in rules(scenario) if given(scenario, row[0])[0]]
        for key, idle, why in (*rows, *unheard(scenario)):
            reasons.setdefault(key, []).append(why if idle else "")
    told = {key: whys[0] for key, whys in reasons.items() if all(whys)}
    told |= dict(replaced_keys(study.config))
    search, horizon = study.config.search, min(cell.scenario.horizon for cell in study.cells)
    if search is not None and search.until < horizon:
        told["search.until"] = f"choices are run to the horizon of {horizon:g} s, which is later"
    return told


def unheard(scenario: Scenario) -> Iterator[tuple[str, bool, str]]:
    """Yield each trusting vehicle and whom it cannot hear."""
    trusted = getattr(scenario.defence, "trusted", None)
    if not (isinstance(trusted, dict) and trusted):
        return
    links = links_of(scenario).pairs()
    for listener, sources in trusted.items():
        beyond = [source for source in sources if (listener - 1, source) not in links]
        why = f"{listener} does not hear {ranges(beyond)}" if beyond else ""
        yield f"defence.trusted.{listener}", bool(beyond), why


def replaced_keys(config: Config) -> Iterator[tuple[str, str]]:
    """Yield the keys outside the sweep that a swept key replaces."""
    for swept, written in config.swept.items():
        value = getattr(config, swept, None)
        if not isinstance(value, BaseModel):
            if given(config, swept)[0]:
                yield swept, f"sweep.{written} replaces it"
            continue
        why = f"sweep.{written} replaces the whole {swept}"
        if type(value) is not type(getattr(DEFAULTS, swept)):
            yield f"{swept}.kind", why
        for key in (f"{swept}.{field}" for field in type(value).model_fields):
            differs, base = given(config, key)
            if differs and not (
                key == "attack.vehicles" and base == usual_targets(config.vehicles)
            ):
                yield key, why
