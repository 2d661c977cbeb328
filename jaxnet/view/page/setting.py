"""The setting of a study: names and values of what was run, with all swept values."""

from collections.abc import Callable, Sequence

from pydantic import BaseModel

from jaxnet.config.cells import Cell
from jaxnet.config.naming import is_kind, key_name, plain_words, unit, value_alone, words_of_kind
from jaxnet.config.scenario import situation_of
from jaxnet.config.study import Study
from jaxnet.kinds.kind import Kind
from jaxnet.model.wording import count, orders_in_words
from jaxnet.statistics.axes import ordered_values
from jaxnet.statistics.curves import configured_magnitude

MOST_ALTERNATIVES = 8
TOLD_ELSEWHERE = (
    "kind",
    "label",
    "edges",
    "content",
    "names",
    "vehicles",
    "links",
    "magnitude",
)  # keys of kinds
PARAMETER_SYMBOLS = {"theta": "ϑ", "F": "F"}  # parameters that are told even at their defaults
OWN_ROWS = (
    "vehicles",
    "attack.magnitude",
    "horizon",
    "tail",
    "tick",
)  # swept keys with a row below


def setting_rows(study: Study) -> dict[str, str]:
    """Return the setting by name; what the study does not have is left out."""
    cells = study.cells

    def among(words: Callable[[Cell], str]) -> str:
        return alternatives(list(dict.fromkeys(map(words, cells))))

    def kinds(
        key: str, of: Callable[[Cell], Kind], absent: Callable[[Cell], bool] = lambda _: False
    ) -> str:
        return among(lambda cell: "none" if absent(cell) else kind_words(key, of(cell), cell))

    rows = {
        "vehicles": f"{among(lambda cell: str(cell.scenario.vehicles))},"
        f" {kinds('vehicle', lambda cell: cell.scenario.vehicle)}",
        "navigator": kinds("navigator", lambda cell: cell.scenario.navigator),
        "network": kinds("topology", lambda cell: cell.scenario.topology),
        "attack": kinds(
            "attack", lambda cell: cell.scenario.attack, lambda cell: not attacks(cell)
        ),
        "attacked signals": among(attacked_words),
        "magnitude ā": among(size_words) + size_unit(cells) if shows_magnitude(study) else "none",
        "defence": kinds("defence", lambda cell: cell.scenario.defence),
        "law": kinds(
            "law", lambda cell: cell.scenario.law, lambda cell: cell.scenario.law.solves()
        ),
        "sensor errors": kinds(
            "sensing",
            lambda cell: cell.scenario.sensing,
            lambda cell: cell.scenario.sensing.exact(),
        ),
        "lost messages": kinds(
            "channel.loss",
            lambda cell: cell.scenario.channel.loss,
            lambda cell: cell.scenario.channel.loss.perfect(),
        ),
        "errors of words": kinds(
            "channel.noise",
            lambda cell: cell.scenario.channel.noise,
            lambda cell: cell.scenario.channel.noise.exact(),
        ),
        "detector": kinds(
            "detector",
            lambda cell: cell.scenario.detector,
            lambda cell: not cell.scenario.detector.present,
        ),
    }
    rows = {
        name: words
        for name, words in rows.items()
        if words != "none" or name in ("attack", "defence")
    }
    own = {key_name(key): values_words(cells, key) for key in cells[0].labels if not has_row(key)}
    return (
        rows
        | own
        | {
            "time": among(
                lambda cell: (
                    f"{cell.scenario.horizon:g} s; the tail is the last {cell.scenario.tail:g} s"
                )
            ),
            "engine": among(
                lambda cell: (
                    f"{cell.scenario.engine.reference()}, ticks of {cell.scenario.tick:g} s"
                )
            ),
        }
    )


def has_row(key: str) -> bool:
    """Return whether a row of its own tells a swept key."""
    return key in OWN_ROWS or is_kind(key)


def alternatives(words: Sequence[str]) -> str:
    """Return the first alternatives as a list, with semicolons where they have commas themselves."""
    shown = [*words[:MOST_ALTERNATIVES], *["…"] * (len(words) > MOST_ALTERNATIVES)]
    return ("; " if any("," in each for each in words) else ", ").join(shown)


def attacked_words(cell: Cell) -> str:
    """Return whose signals the attack falsifies, and whether these vehicles hear or transmit them."""
    attack = cell.scenario.attack
    if not attacks(cell):
        return "none"
    changing = bool(attack.periods())
    one = attack.number() == 1 and "attack.vehicles.random" not in cell.labels and not changing
    if changing:
        whom = f"attacked vehicles ({attack.whom()})"
    elif attack.targets():
        whom = f"vehicle{'' if one else 's'} {attack.whom()}"
    elif "attack.vehicles.random" in cell.labels:
        whom = "drawn vehicles"
    else:
        whom = f"{count(attack.number(), 'drawn vehicle')} of each lane"
    known = situation_of(cell.scenario)
    heard = (known.attacked & (known.graph.sources == 0)).any()
    caveat = f" ({attack.caveat()})" if attack.caveat() else ""
    verb = ("hear" if heard else "transmit") + ("s" if one else "")
    return f"what {whom} {verb}{' of the navigator' if heard else ''}{caveat}"


def attacks(cell: Cell) -> bool:
    """Return whether a cell has an attack with a magnitude."""
    return cell.scenario.attack.number() > 0 and cell.scenario.attack.amplitude() != 0


def shows_magnitude(study: Study) -> bool:
    """Return whether ā scales an attack, or `recovery` compares with it."""
    judged = study.config.recovery is not None
    return any(attacks(cell) and (judged or cell.scenario.attack.bounded) for cell in study.cells)


def size_words(cell: Cell) -> str:
    """Return ā of a cell without its unit, or the magnitude of each order with its unit."""
    amount, sizes = configured_magnitude(cell), cell.scenario.attack.by_order()
    if sizes is not None:
        return f"({orders_in_words(sizes)})"
    return plain_words(amount.model_dump()) if isinstance(amount, BaseModel) else f"{amount:.4g}"


def size_unit(cells: Sequence[Cell]) -> str:
    """Return the unit of ā behind its values, "" where the values have units."""
    return "" if any(cell.scenario.attack.by_order() for cell in cells) else " m"


def kind_words(key: str, kind: Kind, cell: Cell) -> str:
    """Return the name of a kind and its keys that are given and not swept."""
    if key in cell.labels:
        return words_of_kind(key, str(cell.labels[key]))
    given = kind.model_dump()
    default = kind.model_dump(exclude_defaults=True)
    told = [
        f"{PARAMETER_SYMBOLS.get(name, name.replace('_', ' '))} = {plain_words(value)}"
        for name, value in given.items()
        if (name in default or name in PARAMETER_SYMBOLS)
        and name not in TOLD_ELSEWHERE
        and f"{key}.{name}" not in cell.labels
    ]
    return ", ".join([kind.label or kind_name(kind), *told])


def kind_name(kind: Kind) -> str:
    """Return the name of a kind's class in words."""
    return kind.words or kind.reference().rpartition(":")[2].replace("_", " ")


def values_words(cells: Sequence[Cell], key: str) -> str:
    """Return the values of a swept key with their unit."""
    values = [value_alone(key, value) for value in ordered_values(cells, key)]
    return " ".join(filter(None, [alternatives(values), unit(key)]))
