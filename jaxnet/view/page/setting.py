"""The setting of a study: names and values of what was run, with all swept values."""

from collections.abc import Callable, Container, Iterator, Sequence
from operator import attrgetter
from textwrap import shorten
from typing import Any

from pydantic import BaseModel, RootModel
from pydantic.fields import FieldInfo

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config, Recovery, Save, SearchSettings
from jaxnet.config.known import RECORDS
from jaxnet.config.naming import is_kind, key_name, plain_words, unit, unit_in, value_alone
from jaxnet.config.scenario import Scenario, situation_of
from jaxnet.config.study import Study
from jaxnet.kinds.kind import Kind
from jaxnet.kinds.metrics import Metric
from jaxnet.model.wording import count, orders_in_words
from jaxnet.statistics.axes import ordered_values

MOST_ALTERNATIVES = 8
LONGEST_VALUE = 80  # letters
# Keys of kinds that other rows or the figure of the networks tell.
TOLD_ELSEWHERE = {"kind", "label", "edges", "content", "names", "vehicles", "links", "magnitude"}
# Keys that are told even at their defaults, of kinds and of cells: a reader repeats the study.
SYMBOLS = {"theta": "ϑ", "F": "F", "tau": "τ"}
SYMBOLS |= {name: name for name in ("direction", "form", "predicts", "frequency", "phase")}
SYMBOLS |= {name: name for name in ("neighbours", "rewired", "degree", "probability")}
ALWAYS_TOLD = ("navigator", "topology", "attack", "defence", "gain", "initial.position")
# Keys that share a row with others, or stand elsewhere on the page.
OWN_ROWS = ("vehicles", "vehicle", "attack.magnitude", "horizon", "tail", "tick", "engine")
OWN_ROWS += ("name", "seed", "samples", "sweep", "labels")


def setting_rows(study: Study) -> dict[str, str]:
    """Name and value of each key that is not at its default, from the models of the config."""
    cells = study.cells

    def among(words: Callable[[Cell], str]) -> str:
        return alternatives(list(dict.fromkeys(map(words, cells))))

    def kinds(key: str) -> str:
        return among(lambda cell: kind_words(key, cell))

    rows = {"vehicles": f"{among(lambda cell: str(cell.scenario.vehicles))}, {kinds('vehicle')}"}
    for key, field in keys_of_cells():
        values = [attrgetter(key)(cell.scenario) for cell in cells]
        if is_kind(key):
            if key in ALWAYS_TOLD or any(map(field_differs, [field] * len(values), values)):
                rows[key_name(key)] = kinds(key)
        elif key not in cells[0].labels and (
            key in ALWAYS_TOLD or any(field_differs(field, each) for each in values)
        ):
            found = dict.fromkeys(value_words(field, each) for each in values)
            if words := alternatives(list(filter(None, found))):
                rows[key_name(key)] = words
        if key == "attack" and any(attacks(cell.scenario) for cell in cells):
            attacked = (attacked_words(each) for each in cells if attacks(each.scenario))
            rows["attacked signals"] = alternatives([*dict.fromkeys(attacked)])
            scenarios = [cell.scenario for cell in cells if attacks(cell.scenario)]
            # ā scales an attack, or `recovery` compares with it
            if study.config.recovery is not None or any(s.attack.bounded for s in scenarios):
                orders = any(cell.scenario.attack.by_order() for cell in cells)
                rows["magnitude ā"] = among(size_words) + ("" if orders else " m")
    if any(cell.scenario.formation.present for cell in cells):
        start = key_name("initial.position")
        rows[start] = f"{rows.get(start, '')}, and the place in the formation added".lstrip(", ")
    for key in cells[0].labels:
        if key not in OWN_ROWS and not is_kind(key):
            values = [value_alone(key, value) for value in ordered_values(cells, key)]
            rows[key_name(key)] = " ".join(filter(None, [alternatives(values), unit(key)]))
    rows["time"] = among(
        lambda cell: f"{cell.scenario.horizon:g} s; the tail is the last {cell.scenario.tail:g} s"
    )
    rows["engine"] = among(
        lambda cell: f"{kind_words('engine', cell)}, ticks of {cell.scenario.tick:g} s"
    )
    for name, field in Config.model_fields.items():
        value = getattr(study.config, name)
        if name not in {*OWN_ROWS, *Scenario.model_fields} and field_differs(field, value):
            rows[words_in(name)] = value_words(field, value)
    return rows


def keys_of_cells() -> Iterator[tuple[str, FieldInfo]]:
    """Dotted keys of a cell with their fields: keys of records too, but not keys of kinds."""
    for name, field in Scenario.model_fields.items():
        if name in RECORDS:
            inside = RECORDS[name].model_fields.items()
            yield from ((f"{name}.{key}", each) for key, each in inside if key != "label")
        elif name not in OWN_ROWS:
            yield name, field


def field_differs(field: FieldInfo | None, value: object) -> bool:
    return field is None or value != field.get_default(call_default_factory=True)


def told_keys(model: BaseModel, without: Container[str] = ()) -> list[str]:
    """Keys of a kind or record that are not at their defaults, with values and units."""
    told = []
    for name in type(model).model_fields | (model.model_extra or {}):
        field, value = type(model).model_fields.get(name), getattr(model, name)
        elsewhere = isinstance(model, Kind) and name in TOLD_ELSEWHERE
        if elsewhere or name in without or (name in SYMBOLS and value is None):
            continue
        if name in SYMBOLS or field_differs(field, value):
            shown = "" if value is True else f" = {value_words(field, value)}"
            told.append(f"{SYMBOLS.get(name, words_in(name))}{shown}")
    return told


def value_words(field: FieldInfo | None, value: Any) -> str:
    """A value with its unit, or the keys of a record that are not at their defaults."""
    if isinstance(value, Kind):
        return value.label or kind_name(value)
    if isinstance(value, Recovery | SearchSettings | Save):
        return ", ".join(told_keys(value))
    if isinstance(value, list) and value and isinstance(value[0], Metric):
        named = ((each.words or words_in(each.name), each.column_unit) for each in value)
        return alternatives([f"{words} [{of}]" if of else words for words, of in named])
    plain = RootModel[Any](value).model_dump()
    words = f"{plain_words(plain)} {unit_in(field.description if field else None)}".strip()
    return shorten(words, LONGEST_VALUE, placeholder=" …")


def words_in(name: str) -> str:
    return name.replace("_", " ")


def alternatives(words: Sequence[str]) -> str:
    """The first alternatives as a list; semicolons part alternatives that contain commas."""
    shown = [*words[:MOST_ALTERNATIVES], *["…"] * (len(words) > MOST_ALTERNATIVES)]
    return ("; " if any("," in each for each in words) else ", ").join(shown)


def attacks(scenario: Scenario) -> bool:
    return scenario.attack.number() > 0 and scenario.attack.amplitude() != 0


def attacked_words(cell: Cell) -> str:
    """Vehicles whose signals the attack falsifies, and whether they hear or transmit these."""
    attack, drawn = cell.scenario.attack, "attack.vehicles.random" in cell.labels
    changing = bool(attack.periods())
    one = attack.number() == 1 and not drawn and not changing
    if changing:
        whom = f"attacked vehicles ({attack.whom()})"
    elif attack.targets():
        whom = f"vehicle{'' if one else 's'} {attack.whom()}"
    elif drawn:
        whom = "drawn vehicles"
    else:
        whom = f"{count(attack.number(), 'vehicle')}, drawn for each lane,"
    known = situation_of(cell.scenario)
    heard = (known.attacked & (known.graph.sources == 0)).any()
    caveat = f" ({attack.caveat()})" if attack.caveat() else ""
    verb = ("hear" if heard else "transmit") + "s" * one
    return f"what {whom} {verb}{' of the navigator' * bool(heard)}{caveat}"


def size_words(cell: Cell) -> str:
    """ā of a cell without its unit, or the magnitude of each order with its unit."""
    amount, sizes = cell.scenario.attack.amplitude(), cell.scenario.attack.by_order()
    if sizes is not None:
        return f"({orders_in_words(sizes)})"
    return plain_words(amount.model_dump()) if isinstance(amount, BaseModel) else f"{amount:.4g}"


def kind_words(key: str, cell: Cell) -> str:
    """A kind and its keys not at defaults and not swept; in brackets what its label leaves out."""
    kind: Kind = attrgetter(key)(cell.scenario)
    swept = {each.removeprefix(f"{key}.") for each in cell.labels}
    told = [kind_name(kind), *told_keys(kind, swept)]
    said = (kind.label or "").replace(" ", "").casefold()
    more = ", ".join(each for each in told if each.replace(" ", "").casefold() not in said)
    return f"{kind.label} ({more})" if said and more else kind.label or more


def kind_name(kind: Kind) -> str:
    return kind.words or words_in(kind.reference().rpartition(":")[2])


def nested_name(kind: Any) -> str:
    """A kind, with the kind that is its key `of`."""
    inner = getattr(kind, "of", None)
    of = f" of {kind_name(inner)}" if isinstance(inner, Kind) else ""
    return kind.label or f"{kind_name(kind)}{of}"
