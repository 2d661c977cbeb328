"""The setting of a study: names and values of what was run, with all swept values."""

from collections.abc import Callable, Sequence
from operator import attrgetter

from pydantic import BaseModel

from jaxnet.config.cells import Cell
from jaxnet.config.naming import is_kind, key_name, plain_words, unit, value_alone, words_of_kind
from jaxnet.config.scenario import Scenario, situation_of
from jaxnet.config.study import Study
from jaxnet.kinds.kind import Kind
from jaxnet.model.wording import count, orders_in_words
from jaxnet.statistics.axes import ordered_values
from jaxnet.statistics.curves import configured_magnitude

MOST_ALTERNATIVES = 8
# Keys of kinds that other rows tell, or nobody wants told.
TOLD_ELSEWHERE = "kind", "label", "edges", "content", "names", "vehicles", "links", "magnitude"
PARAMETER_SYMBOLS = {"theta": "ϑ", "F": "F"}  # parameters that are told even at their defaults
# Swept keys with a row of their own.
OWN_ROWS = ("vehicles", "attack.magnitude", "horizon", "tail", "tick")
ALWAYS_TOLD = ("attack", "defence")
# Rows about a kind: its key, and whether a scenario goes without.
KIND_ROWS: dict[str, tuple[str, Callable[[Scenario], bool]]] = {
    "navigator": ("navigator", lambda _: False),
    "network": ("topology", lambda _: False),
    "attack": ("attack", lambda scenario: not attacks(scenario)),
    "defence": ("defence", lambda _: False),
    "law": ("law", lambda scenario: scenario.law.solves()),
    "sensor errors": ("sensing", lambda scenario: scenario.sensing.exact()),
    "lost messages": ("channel.loss", lambda scenario: scenario.channel.loss.perfect()),
    "errors of messages": ("channel.noise", lambda scenario: scenario.channel.noise.exact()),
    "detector": ("detector", lambda scenario: not scenario.detector.present),
}


def setting_rows(study: Study) -> dict[str, str]:
    """The setting by name; what the study does not have is left out."""
    cells = study.cells

    def among(words: Callable[[Cell], str]) -> str:
        return alternatives(list(dict.fromkeys(map(words, cells))))

    def kinds(key: str, absent: Callable[[Scenario], bool]) -> str:
        return among(lambda cell: "none" if absent(cell.scenario) else kind_words(key, cell))

    fleet = among(lambda cell: str(cell.scenario.vehicles))
    rows = {"vehicles": f"{fleet}, {kinds('vehicle', lambda _: False)}"}
    for name, (key, absent) in KIND_ROWS.items():
        words = kinds(key, absent)
        if words != "none" or name in ALWAYS_TOLD:
            rows[name] = words
        if name == "attack" and words != "none":
            rows["attacked signals"] = among(attacked_words)
            scenarios = [cell.scenario for cell in cells if attacks(cell.scenario)]
            # ā scales an attack, or `recovery` compares with it
            if study.config.recovery is not None or any(s.attack.bounded for s in scenarios):
                orders = any(cell.scenario.attack.by_order() for cell in cells)
                rows["magnitude ā"] = among(size_words) + ("" if orders else " m")
    for key in cells[0].labels:
        if key not in OWN_ROWS and not is_kind(key):
            values = [value_alone(key, value) for value in ordered_values(cells, key)]
            rows[key_name(key)] = " ".join(filter(None, [alternatives(values), unit(key)]))
    rows["time"] = among(
        lambda cell: f"{cell.scenario.horizon:g} s; the tail is the last {cell.scenario.tail:g} s"
    )
    rows["engine"] = among(
        lambda cell: f"{cell.scenario.engine.reference()}, ticks of {cell.scenario.tick:g} s"
    )
    return rows


def alternatives(words: Sequence[str]) -> str:
    """The first alternatives as a list, with semicolons where they have commas themselves."""
    shown = [*words[:MOST_ALTERNATIVES], *["…"] * (len(words) > MOST_ALTERNATIVES)]
    return ("; " if any("," in each for each in words) else ", ").join(shown)


def attacks(scenario: Scenario) -> bool:
    return scenario.attack.number() > 0 and scenario.attack.amplitude() != 0


def attacked_words(cell: Cell) -> str:
    """Whose signals the attack falsifies, and whether these vehicles hear or transmit them."""
    attack, drawn = cell.scenario.attack, "attack.vehicles.random" in cell.labels
    if not attacks(cell.scenario):
        return "none"
    changing = bool(attack.periods())
    one = attack.number() == 1 and not drawn and not changing
    if changing:
        whom = f"attacked vehicles ({attack.whom()})"
    elif attack.targets():
        whom = f"vehicle{'' if one else 's'} {attack.whom()}"
    elif drawn:
        whom = "drawn vehicles"
    else:
        whom = f"{count(attack.number(), 'drawn vehicle')} of each lane"
    known = situation_of(cell.scenario)
    heard = (known.attacked & (known.graph.sources == 0)).any()
    caveat = f" ({attack.caveat()})" if attack.caveat() else ""
    verb = ("hear" if heard else "transmit") + "s" * one
    return f"what {whom} {verb}{' of the navigator' * bool(heard)}{caveat}"


def size_words(cell: Cell) -> str:
    """ā of a cell without its unit, or the magnitude of each order with its unit."""
    amount, sizes = configured_magnitude(cell), cell.scenario.attack.by_order()
    if sizes is not None:
        return f"({orders_in_words(sizes)})"
    return plain_words(amount.model_dump()) if isinstance(amount, BaseModel) else f"{amount:.4g}"


def kind_words(key: str, cell: Cell) -> str:
    """The name of a kind and its keys that are given and not swept."""
    if key in cell.labels:
        return words_of_kind(key, str(cell.labels[key]))
    kind: Kind = attrgetter(key)(cell.scenario)
    given = {*kind.model_dump(exclude_defaults=True), *PARAMETER_SYMBOLS} - {*TOLD_ELSEWHERE}
    told = [
        f"{PARAMETER_SYMBOLS.get(name, name.replace('_', ' '))} = {plain_words(value)}"
        for name, value in kind.model_dump().items()
        if name in given and f"{key}.{name}" not in cell.labels
    ]
    name = kind.words or kind.reference().rpartition(":")[2].replace("_", " ")
    return ", ".join([kind.label or name, *told])
