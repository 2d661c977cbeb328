"""Write the tables of config.md, from the schema and the kinds: `python docs/site/keys.py`."""

import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from jaxnet.config.keys import Config
from jaxnet.config.schema import DEFAULT_KINDS, config_schema
from jaxnet.kinds import registry
from jaxnet.kinds.kind import Kind

PAGE = Path(__file__).parents[1] / "config.md"
MARK = "<!-- From here on written by docs/site/keys.py -->\n"
HEAD = "| key | takes | default | what it is |\n|---|---|---|---|\n"
LIMITS = {
    "exclusiveMinimum": "> {}",
    "minimum": "≥ {}",
    "exclusiveMaximum": "< {}",
    "maximum": "≤ {}",
}
LIMITS["multipleOf"] = "a multiple of {}"
WORDS = {"integer": "whole number", "boolean": "true or false", "string": "text", "null": "nothing"}
DRAWN = ("Uniform", "Normal", "DiscreteChoice")
PARTS = {
    "initial": "Initial",
    "channel": "Channel",
    "recovery": "Recovery",
    "search": "SearchSettings",
    "save": "Save",
    "samples.until": "Criterion",
}


def main() -> None:
    """Write the page's tables anew."""
    PAGE.write_text(current(PAGE.read_text()))


def current(page: str) -> str:
    """The page with its tables as they should be now."""
    prose, mark, _ = page.partition(MARK)
    whole = config_schema()
    inner = {key: whole["$defs"][name] for key, name in PARTS.items()}
    parts = [section("Keys of a study", whole, Config.model_fields)]
    parts += [section(key, each, each["properties"]) for key, each in inner.items()]
    parts += [part for family in DEFAULT_KINDS for part in of_family(family, whole["$defs"])]
    metrics = (registry.find("metrics", name) for name in registry.kind_names("metrics"))
    parts += [
        "## metrics\n",
        *(f"`{each.name}` [{each.unit}]: {each.words}.\n" for each in metrics),
    ]
    return "\n".join([prose + mark, *parts])


def of_family(family: str, known: dict[str, Any]) -> Iterator[str]:
    """The kinds of a family: what several share, then each with its own keys."""
    kinds = {name: registry.find(family, name) for name in registry.kind_names(family)}
    yield f"## {family}\n"
    for base in dict.fromkeys(base for kind in kinds.values() for base in kind.__mro__[1:]):
        if keys := own(base):
            having = [name for name, kind in kinds.items() if issubclass(kind, base)]
            yield section(
                titled(having, list(kinds)), known[kinds[having[0]].__name__], keys, level=3
            )
    for name, kind in kinds.items():
        words = inspect.cleandoc(kind.__doc__ or "")
        if promise := getattr(kind, "guarantee", ""):
            words += f"\n\nGuarantee: {promise}."
        yield section(f"`{name}`", known[kind.__name__], own(kind), 3, wrapped(words))


def wrapped(text: str) -> str:
    """Text of paragraphs and lists in lines of at most 98 characters, none of which begins with a minus."""
    parts = re.split(r"(\n(?=- )|\n\n)", text)  # blocks, and what parts them
    for number in range(0, len(parts), 2):
        words = " ".join(parts[number].split()).replace(" - ", "\0-\0")
        indent = "  " if words.startswith("- ") else ""
        lines = textwrap.wrap(
            words, 98, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
        )
        parts[number] = "\n".join(lines).replace("\0", " ")
    return "".join(parts)


def titled(names: list[str], among: list[str]) -> str:
    """Names among others, or these others if they are fewer; "all" if there are no others."""
    others = [name for name in among if name not in names]
    shown = ", ".join(f"`{name}`" for name in min(others, names, key=len))
    return shown if len(names) <= len(others) else f"all but {shown}" if others else "all"


def own(kind: Any) -> list[str]:
    """Keys that a class says itself; of what all kinds have, none."""
    said = inspect.get_annotations(kind) if issubclass(kind, Kind) and kind is not Kind else {}
    return [key for key in said if key in kind.model_fields]


def section(title: str, model: Any, keys: Iterable[str], level: int = 2, words: str = "") -> str:
    """A heading, words, and the table of a model's keys, those that must be given first."""
    required = model.get("required", [])
    rows = [row(key, model["properties"][key], key in required) for key in keys]
    rows.sort(key=lambda cells: cells[2] != "required")
    table = HEAD + "".join(f"| {' | '.join(cells)} |\n" for cells in rows) if rows else ""
    return (
        "\n\n".join(filter(None, [f"{'#' * level} {title}", words.rstrip(), table.rstrip()])) + "\n"
    )


def row(key: str, node: Any, required: bool) -> list[str]:
    """Cells of a key: what it takes, its default, its meaning with its unit in brackets."""
    given = node.get("default")
    default = "its own" if "$ref" in node and isinstance(given, dict) else f"`{plain(given)}`"
    return [
        f"`{key}`",
        takes(node),
        "required" if required else default,
        node.get("description", ""),
    ]


def takes(node: Any) -> str:
    """What values a part of the schema allows, in words."""
    limits = ", ".join(
        each.format(plain(node[name])) for name, each in LIMITS.items() if name in node
    )
    return f"{allowed(node)} {limits}".rstrip()


def allowed(node: Any) -> str:
    """The same but for limits."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        return REFERENCES.get(name, f"[{name.lower()}](#{name.lower()})")
    if choices := node.get("anyOf", node.get("oneOf")):
        return " or ".join(dict.fromkeys(takes(each) for each in choices if "pattern" not in each))
    if words := node.get("enum", [node["const"]] if "const" in node else []):
        return " or ".join(f"`{each}`" for each in words)
    if "prefixItems" in node:
        return f"[{', '.join(takes(each) for each in node['prefixItems'])}]"
    if node.get("type") == "array":
        many = f"{node['minItems']}" if "maxItems" in node else "any length"
        return f"list of {many}: {takes(node['items'])}"
    if node.get("type") == "object":
        return f"mapping to {takes(node['additionalProperties'])}"
    kind: str = node.get("type", "anything")
    return WORDS.get(kind, kind)


# What a reference says where it is not the name of a heading.
REFERENCES = {
    **dict.fromkeys(DRAWN, "distribution"),
    "SearchSettings": "[search](#search)",
    "Sequential": "{[until](#samplesuntil): …}",
    "DrawnVehicles": "{random: n}",
    "ChangingVehicles": "[{at: […], sets: […]}](#other-vehicles-from-given-times-on)",
    "EachOrder": "[one for each order](#a-magnitude-for-each-order)",
    **dict.fromkeys(
        ("Apiece", "Shared", "Listed"), "[one for each](#one-for-each-attacked-vehicle)"
    ),
    "NearestSources": "{nearest: n}",
    "Samples": "{samples: […]}",
    "ShareOfLinks": "{share: s, seed: n}",
    "ShareOfVehicles": "{share: s}",
    "WorstLanes": "{worst: K}",
    "ChosenVehicles": "{choose: n}",
    "Table": "a list of lists",
    "EachPosition": "a list of places",
    "AxisGains": "a list for each axis",
    "MatrixGains": "a list of 2 × 2 matrices",
    "VehicleGains": "{vehicles: a list for each}",
    "EachIn": "{each: [a, b]}",
    "Linspace": "{linspace: [a, b, n]}",
    "Geomspace": "{geomspace: [a, b, n]}",
}


def plain(value: Any) -> str:
    """A value as YAML would have it on a line, six digits of a number."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {plain(each)}' for key, each in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(plain, value))}]"
    if value is None or isinstance(value, bool):
        return str(value).lower().replace("none", "null")
    return f"{value:.6g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
