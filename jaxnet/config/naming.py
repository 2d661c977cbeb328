"""Names of swept keys and of their values, as tables, figures and pages show them.

Tables have the labels of a cell: numbers, or text. Figures and pages have words and units. A key's
name comes from the config (`labels`), else from the key's field (`title`), else from its words:
`attack.frequency` is "attack frequency". Its unit stands in the brackets of its description.
"""

import functools
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from jaxnet.config.document import Plain, PlainMapping, escape_controls
from jaxnet.config.keys import INNER_KINDS, KINDS, Scenario
from jaxnet.config.known import model_of, models_in, with_kind
from jaxnet.config.sweep import is_joint, keys_in
from jaxnet.kinds import registry
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.refusals import shorten_value, value_text
from jaxnet.model.wording import orders_in_words, sets_in_words

MAGNITUDE = "attack.magnitude"
ATTACKED, ATTACKED_NUMBER = "attack.vehicles", "attack.vehicles.random"
NO_BREAK = "\N{NO-BREAK SPACE}"
SILENT = {"label", "edges", "content", "names"}  # keys of kinds that nobody wants told
UNLABELLED_KEYS = {"kind", *SILENT}  # of kinds, that labels leave out


class Key(str):
    """A dotted key with the name that its study's config gives it, None without one."""

    name: str | None

    def __new__(cls, key: str, name: str | None = None) -> "Key":
        made = super().__new__(cls, key)
        made.name = name
        return made


# --- labels in tables -----------------------------------------------------------------------------


def value_labels(key: str, listed: list[Plain]) -> list[Plain]:
    """Return the labels of one key's swept values: all numbers, or all text.

    A kind is labelled by its `label`, or by its name with the keys that tell it apart from others
    of that name; a record, such as a channel, by its `label` or its keys.
    """
    if is_kind(key):
        kinds = [full_kind(INNER_KINDS.get(key, key), value) for value in listed]
        telling = telling_keys(kinds)
        return [escape_controls(kind_label(kind, telling)) for kind in kinds]
    if not all(isinstance(value, int | float) for value in listed):
        return [escape_controls(own_label(value) or value_text(value)) for value in listed]
    fits = all(isinstance(value, float) or -(2**63) <= value < 2**63 for value in listed)
    return listed if fits else list(map(float, listed))  # columns have 64 bits


def own_label(value: Plain) -> str:
    """Return text itself, or the `label` of a mapping; "" of another value."""
    told = value.get("label") if isinstance(value, dict) else value
    return told if isinstance(told, str) else ""


def full_kind(field: str, value: Plain) -> Plain:
    """Return the mapping of a kind with its defaults."""
    value = with_kind(field, value)
    model = model_of(field, value) if isinstance(value, dict) else None
    if model is None:
        return value
    fields = model.model_fields
    defaults = {key: each.default for key, each in fields.items() if not each.is_required()}
    return {key: to_plain(each) for key, each in (defaults | value).items()}


def to_plain(value: Plain) -> Plain:
    """Return models, mappings and lists as plain data, without labels that are None."""
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="python")
    if isinstance(value, list | tuple):
        return [to_plain(each) for each in value]
    if not isinstance(value, dict):
        return value
    told = (pair for pair in value.items() if pair != ("label", None))
    return {key: to_plain(each) for key, each in told}


def telling_keys(kinds: list[Plain]) -> dict[str, list[object]]:
    """Return, by name of a kind, the keys in which swept kinds of this name differ."""
    found: dict[str, list[object]] = {}
    first: dict[str, PlainMapping] = {}
    for kind in kinds:
        if isinstance(kind, dict) and "kind" in kind:
            name = value_text(kind["kind"])
            other, keys = first.setdefault(name, kind), found.setdefault(name, [])
            differing = (key for key in {**other, **kind} if other.get(key) != kind.get(key))
            keys += [key for key in differing if key not in {*UNLABELLED_KEYS, *keys}]
    return found


def kind_label(kind: Plain, telling: Mapping[str, list[object]]) -> str:
    if not isinstance(kind, dict) or "kind" not in kind:
        return shorten_value(kind)
    if own := own_label(kind):
        return own
    keys = telling[value_text(kind["kind"])]
    words = [f"{key}={shorten_value(value)}" for key, value in kind.items() if key in keys]
    name = str(kind["kind"]).rpartition(":")[2]
    return name + (f"({', '.join(words)})" if words else "")


# --- words in figures and pages -------------------------------------------------------------------


def label_notes(sweep: Mapping[str, Any], cells: Sequence[Mapping[str, object]]) -> list[str]:
    """Return what the labels of a config's sweep stand for that the labels of cells have."""
    found, shown = [], {label for labels in cells for label in labels.values()}
    for written, listed in sweep.items():
        for entry in listed if isinstance(listed, list) else ():
            if not isinstance(entry, dict) or entry.get("label") not in shown:
                continue
            words = plain_words({key: each for key, each in entry.items() if key not in SILENT})
            if is_joint(written):
                given = zip(keys_in(written), entry["values"], strict=True)
                words = labels_title({key: value_labels(key, [each])[0] for key, each in given})
            if not is_told(words, entry["label"]):
                found.append(f"{entry['label']}: {words}")
    return found


def is_told(words: str, label: str) -> bool:
    """Whether a label has all these words, or longer words' beginnings: "geo. median"."""
    said, names = (re.findall(r"\d[\d.]*|[^\W\d_]+", each.casefold()) for each in (label, words))
    begun = tuple(each for each in said if len(each) > 2)
    return all(each in {"kind", *said} or each.startswith(begun) for each in names)


def labels_title(labels: Mapping[str, object]) -> str:
    """The title of a panel or row: its swept values, with keys where a value is unclear.

    A label stands for the values of its keys.
    """
    told = {key for joint in filter(is_joint, labels) for key in keys_in(joint)}
    return ", ".join(value_name(key, value) for key, value in labels.items() if key not in told)


Combination = tuple[Any, ...]  # values of some swept keys


def choices_words(
    some: Sequence[Mapping[str, object]], there: Sequence[Mapping[str, object]]
) -> list[str]:
    """A phrase for each product of swept values that some labels fill; keys with all are silent."""
    found = []
    for box in boxes_of([tuple(labels.values()) for labels in some]):
        told = {
            values_named(key, each, "and"): len(each) > 1
            for key, each in zip(there[0], box, strict=True)
            if {labels[key] for labels in there} != {*each}
        }
        words = [*told]
        if sum(told.values()) > 1:
            words = [" × ".join(f"({each})" if told[each] else each for each in told)]
        found.append(", ".join(words) or "all")
    return found


def boxes_of(combinations: Collection[Combination]) -> list[list[Combination]]:
    """Few products of sets of values, one set a key, that make up these combinations."""
    if () in combinations:
        return [[]]
    rests: dict[Any, dict[Combination, None]] = {}
    for first, *rest in combinations:
        rests.setdefault(first, {})[tuple(rest)] = None
    alike: dict[frozenset[Combination], list[Any]] = {}
    for first, rest in rests.items():
        alike.setdefault(frozenset(rest), []).append(first)
    boxes = ((firsts, boxes_of(rests[firsts[0]])) for firsts in alike.values())
    return [[tuple(firsts), *box] for firsts, inner in boxes for box in inner]


def value_name(key: str, value: object) -> str:
    """Return the name of a swept value with its unit, which non-breaking spaces join."""
    if is_joint(key):
        return str(value)
    if value == "none":
        return f"no{NO_BREAK}{key_name(key)}"
    if is_kind(key):
        words = words_of_kind(key, str(value))
        # A label such as 20 % does not say of what
        return (
            words
            if any(map(str.isalpha, words))
            else f"{key_name(key)}{NO_BREAK}={NO_BREAK}{words}"
        )
    if own_name(key) is None and key in (ATTACKED, ATTACKED_NUMBER):
        given = yaml.safe_load(value) if isinstance(value, str) else value
        number = given.get("random", 0) if isinstance(given, dict) else given
        if isinstance(number, int) and number:
            return f"{number}{NO_BREAK}attacked,{NO_BREAK}drawn"
    shown = magnitudes_with_units(key, value)
    name = (
        f"ā{NO_BREAK}="
        if key == MAGNITUDE and own_name(key) is None
        else f"{key_name(key)}{NO_BREAK}="
    )
    words = [name, shown] if shown else [name, format_value(value), unit(key)]
    return NO_BREAK.join(filter(None, words))


def values_named(key: str, values: Sequence[object], joint: str) -> str:
    """Values of a key joined by a word, with the key's name and unit told once."""
    names = [value_name(key, each) for each in values]
    name, equals, value = names[-1].partition(f"={NO_BREAK}")
    if len(names) == 1 or not all(each.startswith(f"{name}=") for each in names):
        parts = [each.partition(NO_BREAK) for each in names]
        if len({rest for *_, rest in parts}) == 1:  # such as "1 attacked", "2 attacked"
            names = [*(first for first, *_ in parts[:-1]), names[-1]]
        return f" {joint} ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
    alone = [value_alone(key, each) for each in values[:-1]]
    if any("," in each for each in (*alone, value)):  # lists
        return f"{name}{equals}{'; '.join([*alone, value])}"
    return f"{name}{equals}{', '.join(alone)} {joint} {value}"


def magnitudes_with_units(key: str, value: object) -> str:
    """Return a swept list of magnitudes with the unit of each order, "" for another value."""
    if key != MAGNITUDE or not str(value).startswith("["):
        return ""
    sizes = [float(size) for size in yaml.safe_load(str(value))]
    return f"({orders_in_words(sizes)})".replace(" m", f"{NO_BREAK}m")


def value_alone(key: str, value: object) -> str:
    """Return a swept value without its key and unit."""
    if is_joint(key) or value == "none":
        return value_name(key, value)
    if is_kind(key):
        return words_of_kind(key, str(value))
    return magnitudes_with_units(key, value) or format_value(value)


def worded(labels: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table's row of swept values: text is a name, numbers stay numbers."""
    return {
        quantity(key): value_alone(key, value) if isinstance(value, str) else value
        for key, value in labels.items()
    }


def quantity(key: str) -> str:
    """Return the label of the axis of a swept key."""
    symbol = " ā" if key == MAGNITUDE and own_name(key) is None else ""
    return f"{key_name(key)}{symbol}" + (f" [{unit(key)}]" if unit(key) else "")


def is_kind(key: str) -> bool:
    return key in KINDS or key in INNER_KINDS


def own_name(key: str) -> str | None:
    """Return the name that the config gives a key, None without one."""
    return key.name if isinstance(key, Key) else None


def key_name(key: str) -> str:
    return own_name(key) or words_of(str(key))


@functools.cache
def words_of(key: str) -> str:
    """Return the name of a key by its field's title, else by its own words."""
    if is_joint(key):
        return " and ".join(map(words_of, keys_in(key)))
    titles = (field.title for field in fields_of(key))
    if title := next(filter(None, titles), None):
        return title
    root, *inside = key.split(".")
    words = inside if root in ("channel", "topology") and inside else [root, *inside]
    if root == "gain" and inside:
        words[-1] = f"k{words[-1]}"
    return " ".join(words).replace("_", " ")


def format_value(value: object) -> str:
    """Return a number with four digits, a list or mapping in words, and other text as it is."""
    if isinstance(value, str) and value.startswith(("[", "{")):
        return plain_words(yaml.safe_load(value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def words_of_kind(key: str, label: str) -> str:
    """Return the label of a kind in words: its class's name, and the keys that tell it apart."""
    name, bracket, inside = label.partition("(")
    try:
        name = registry.find(INNER_KINDS.get(key, key), name).words or name.replace("_", " ")
    except KindError:
        return label  # a label that the config gives
    told = re.sub(r"(\w+)=", r"\1 ", inside).replace('"', "").replace("_", " ")
    return f"{name} ({told}" if bracket else name


def plain_words(value: object) -> str:
    if isinstance(value, dict):
        if set(value) == {"uniform"}:
            return f"uniform {' to '.join(map(format_value, value['uniform']))}"
        if set(value) == {"random"}:  # the number must not read as that of a vehicle
            return f"{value['random']} drawn"
        if set(value) == {"at", "sets"}:  # attacked vehicles, which change
            return sets_in_words(value["at"], value["sets"])
        words = {str(key).replace("_", " "): each for key, each in value.items()}
        return ", ".join(f"{key} {plain_words(inner)}" for key, inner in words.items())
    if isinstance(value, list):
        words = {True: "({})", False: "{}"}
        return ", ".join(words[isinstance(each, list)].format(plain_words(each)) for each in value)
    return format_value(value)


@functools.cache
def unit(key: str) -> str:
    """Return the unit in a key's description, "" without one; an entry has that of its list."""
    fields = fields_of(re.sub(r"(\.[0-9]+)+$", "", key))
    return next(filter(None, (unit_in(field.description) for field in fields)), "")


def unit_in(description: str | None) -> str:
    """Return the unit with which a description begins, "" without one."""
    found = re.match(r"\[([^],]+)", description or "")
    return found[1] if found else ""


def fields_of(key: str) -> list[FieldInfo]:
    """Return the fields that a dotted key has in the models of its root, the first kind first."""
    root, *inside = key.split(".")
    found = [] if is_joint(key) else [Scenario.model_fields[root]]
    for name in inside:
        models = (model for field in found for model in models_in(field))
        found = [model.model_fields[name] for model in models if name in model.model_fields]
    return found
