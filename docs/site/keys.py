"""Write the tables of config.md, from the schema and the kinds: `python docs/site/keys.py`."""

import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from jaxnet.config.schema import DEFAULT_KINDS, NAME, config_schema
from jaxnet.kinds import registry
from jaxnet.kinds.kind import Kind

PAGE = Path(__file__).parents[1] / "config.md"
MARK = "<!-- From here on written by docs/site/keys.py -->\n"
LIMITS = {
    "exclusiveMinimum": "> {}",
    "minimum": "≥ {}",
    "exclusiveMaximum": "< {}",
    "maximum": "≤ {}",
}
LIMITS["multipleOf"] = "a multiple of {}"
WORDS = {"integer": "integer", "boolean": "boolean", "string": "text", "null": "null"}
EACH = "[each](#one-for-each-attacked-vehicle)"
DRAWN = ("Uniform", "Normal", "DiscreteChoice")
GROUPS = {  # of the keys of a study
    "The study": "name seed samples draws engine sweep labels",
    "Time": "horizon tick output_step tail",
    "The fleet": "vehicles topology navigator vehicle initial gain law formation filter",
    "Attack and messages": "attack defence sensing channel detector",
    "What is measured": "metrics recovery search save",
}
PARTS = {
    "initial": "Initial",
    "channel": "Channel",
    "recovery": "Recovery",
    "search": "SearchSettings",
    "save": "Save",
    "samples.until": "Criterion",
}
ELSEWHERE = {  # kinds of which a page says what their docstring says after its first paragraph
    "edges": "[the local law](model.md#the-local-law)",
    "file of topology": "[networks from files](#networks-from-files)",
    "switching": "[switching networks](theorems.md#o14-networks-in-turn)",
    "driven": "[navigator](model.md#navigator)",
    "none of navigator": "[without a navigator](model.md#without-a-navigator)",
    "spoof": "[O10](theorems.md#o10-inconsistent-derivatives)",
    "trust": "[trust that learns](trust.md)",
    "vote": "[theorem 7](guarantees.md#theorem-7-a-vote)",
    "trusted_trim": "[trimming](model.md#defence), [announcements](guarantees.md#announcements)",
    "linearised": "[the linearised law](model.md#the-linearised-law)",
    "local": "[the local law](model.md#the-local-law)",
    "rounds": "[rounds.md](rounds.md)",
    "gaussian of sensing": "[O13](theorems.md#o13-sensor-errors)",
    "gaussian of noise": "[O15](theorems.md#o15-substituted-messages)",
    "chi_squared": "[O17](theorems.md#o17-alarms)",
    "cusum": "[tests](detectors.md#tests)",
    "kalman": "[what is predicted](detectors.md#what-is-predicted)",
    "robotarium": "[limits](robots.md#limits)",
    "look_ahead": "[its heading](model.md#vehicles-of-other-orders)",
    "nonlinear": "[how](numerics.md#the-nonlinear-engine)",
    "collisions": "[collisions](robots.md#collisions-and-robots-outside)",
    "outside_arena": "[robots outside](robots.md#collisions-and-robots-outside)",
    "barrier": "[a filter against collisions](robots.md#a-filter-against-collisions)",
    "sampled": "[a digital controller](robots.md#a-digital-controller)",
    "consistent": "[B1](guarantees.md#assumptions-b1-to-c3)",
}
EXAMPLES = {
    "metrics": "metrics: [min_separation, {kind: settling_time, below: 0.1, name: near}]",
    "topology": "topology: {kind: lattice, neighbours: 4, navigator: [1, 2]}",
    "navigator": "navigator: {kind: lissajous, amplitude: [80, 40], frequency: [0.1, 0.2]}",
    "vehicle": "vehicle: {kind: car, wheelbase: 0.6}",
    "attack": "attack: {kind: sinusoid, magnitude: 10, vehicles: [2, 5], frequency: 0.35}",
    "defence": "defence: {kind: w_msr, F: 2, trusted: {nearest: 1}, isolated: coast}",
    "formation": "formation: {kind: circle, radius: 2}",
    "filter": "filter: {kind: barrier, form: halves, distance: 0.2}",
    "law": "law: {kind: rounds, rounds: 2}",
    "sensing": "sensing: {position: 0.1, correlation: 1, outliers: 0.01}",
    "detector": "detector: {kind: chi_squared, false_alarms: 0.001, cuts: message}",
    "observer": "detector: {kind: distance, predicts: truth}",
    "engine": "engine: {kind: nonlinear, solver: dopri8, rtol: 1e-9}",
    "announcement": "attack: {announces: {kind: free, size: 2}}",
    "loss": "channel: {loss: {kind: gilbert_elliott, fail: 0.02, recover: 0.2}}",
    "noise": "channel: {noise: {position: 0.1, of: transmitter}}",
}


def main() -> None:
    """Write the page's tables anew."""
    PAGE.write_text(current(PAGE.read_text()))


def current(page: str) -> str:
    """The page with its tables as they should be now."""
    prose, mark, _ = page.partition(MARK)
    whole = config_schema()
    inner = {key: whole["$defs"][name] for key, name in PARTS.items()}
    parts = ["## Keys of a study\n"]
    parts += [section(title, rows(whole, keys.split()), 3) for title, keys in GROUPS.items()]
    parts += [section(key, rows(each, each["properties"])) for key, each in inner.items()]
    said: dict[Any, str] = {}  # base classes whose keys families share, and the first family
    parts += [part for family in DEFAULT_KINDS for part in of_family(family, whole["$defs"], said)]
    parts += of_metrics(whole["$defs"])
    return "\n".join([prose + mark, *parts]) + "\n"


def of_family(family: str, known: dict[str, Any], said: dict[Any, str]) -> Iterator[str]:
    """The kinds of a family: an example, shared keys, then each with its own keys."""
    kinds = {name: registry.find(family, name) for name in registry.kind_names(family)}
    tables = {name: rows(known[kind.__name__], own(kind)) for name, kind in kinds.items()}
    yield f"## {family}\n"
    if family in EXAMPLES:
        yield f"    {EXAMPLES[family]}\n"
    for base in dict.fromkeys(base for kind in kinds.values() for base in kind.__mro__[1:]):
        having = [name for name, kind in kinds.items() if issubclass(kind, base)]
        if keys := [
            key for key in own(base) if not all(key in own(kinds[name]) for name in having)
        ]:
            title = f"Keys of {titled(having, list(kinds))}"
            if base in said:
                yield f"{title}: those of [{said[base]}](#{said[base]}).\n"
            else:
                yield section(title, rows(known[kinds[having[0]].__name__], keys), 3)
                said[base] = family
    if shared := alike(tables):
        yield section("Keys of several kinds", shared, 3)
    for name, kind in kinds.items():
        yield section(f"`{name}`", tables[name], 3, described(name, family, kind))


def described(name: str, family: str, kind: Any) -> str:
    """What a docstring says, or its first paragraph and the page that says more."""
    words = inspect.cleandoc(kind.__doc__ or "")
    if more := ELSEWHERE.get(name, ELSEWHERE.get(f"{name} of {family}")):
        words = f"{words.partition(chr(10) * 2)[0]} More: {more}."
    return wrapped(words)


def of_metrics(known: dict[str, Any]) -> Iterator[str]:
    """The metrics, then those that have keys."""
    models = registry.models("metrics")
    yield "## metrics\n"
    yield f"    {EXAMPLES['metrics']}\n"
    yield wrapped(f"- `name`: text; {NAME['description']}\n")
    keyless = [name for name in registry.kind_names("metrics") if name not in models]
    for each in (registry.find("metrics", name) for name in keyless):
        unit = f" [{each.column_unit}]" * bool(each.column_unit)
        yield wrapped(f"- `{each.name}`{unit}: {each.words}.")
    for name, model in models.items():
        table = rows(known[model.__name__], model.model_fields)
        words = described(name, "metrics", model)
        yield "\n" + section(f"`{name}`", table, 3, words).rstrip()


def alike(tables: dict[str, list[str]]) -> list[str]:
    """Rows of the tables of several kinds, taken out of these; the kinds are the second column."""
    shared = []
    for each in dict.fromkeys(row for table in tables.values() for row in table):
        having = [name for name, table in tables.items() if each in table]
        if len(having) > 1:
            key, _, said = each.partition(" | ")
            shared.append(f"{key} | {', '.join(f'`{name}`' for name in having)} | {said}")
            for name in having:
                tables[name].remove(each)
    return shared


def wrapped(text: str) -> str:
    """Text of paragraphs and lists in lines of at most 98 characters; none begins with a minus."""
    parts = re.split(r"(\n(?= *- )|\n\n)", text)  # blocks, and what parts them
    wrap = textwrap.TextWrapper(98, break_long_words=False, break_on_hyphens=False)
    for number in range(0, len(parts), 2):
        item = parts[number].lstrip(" ")
        wrap.initial_indent = " " * (len(parts[number]) - len(item))
        wrap.subsequent_indent = wrap.initial_indent + "  " * item.startswith("- ")
        words = " ".join(item.split()).replace(" - ", "\0-\0")
        parts[number] = wrap.fill(words).replace("\0", " ")
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


def rows(model: Any, keys: Iterable[str]) -> list[str]:
    """Lines of a table for keys of a model, those that must be given first."""
    required = model.get("required", [])
    return [
        row(key, model["properties"][key], key in required)
        for key in sorted(keys, key=lambda key: key not in required)
    ]


def section(title: str, table: list[str], level: int = 2, words: str = "") -> str:
    """A heading, words, and a list of the keys."""
    keys = wrapped("\n".join(map(listed, table)))
    return "\n\n".join(filter(None, [f"{'#' * level} {title}", words.rstrip(), keys])) + "\n"


def listed(line: str) -> str:
    """A row as an item of a list; what each choice means is an item below it."""
    key, *kinds, taken, meaning = line.split(" | ")
    key = " of ".join([key, *kinds])
    choices = re.findall(r"`(\w+)`", taken.rpartition(" (")[0])
    parts = re.split(rf"(?:^|[:;] )({'|'.join(choices)})[,:] ", meaning)
    if taken.startswith("boolean ("):
        return f"- {key} {taken.removeprefix('boolean ')}: {meaning}"
    if len(choices) < 2 or len(parts) != 2 * len(choices) + 1:
        return f"- {key}: {taken}; {meaning}"
    first = ": ".join(filter(None, [f"- {key} {taken.rpartition(' ')[2]}", parts[0]]))
    return "\n    - ".join([first, *map("`{}`: {}".format, parts[1::2], parts[2::2])])


def row(key: str, node: Any, required: bool) -> str:
    """A key, what it takes with its default in brackets, its meaning with its unit in brackets."""
    given = node.get("default")
    default = "" if "$ref" in node and isinstance(given, dict) else f" (`{plain(given)}`)"
    default = ", required" if required else default
    return f"`{key}` | {takes(node)}{default} | {node.get('description', '')}"


def takes(node: Any) -> str:
    """What values a part of the schema allows, in words."""
    if "minimum" in node and "maximum" in node:
        return f"{allowed(node)} {plain(node['minimum'])}…{plain(node['maximum'])}"
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
        said = dict.fromkeys(takes(each) for each in choices if "pattern" not in each)
        said.pop("null", None)
        if len(said) > 3:  # the meaning names them
            return "several forms"
        return (
            " or ".join(said)
            .replace("number or distribution", "draw")
            .replace(f"draw or {EACH}", EACH)
        )
    if words := node.get("enum", [node["const"]] if "const" in node else []):
        return ", ".join(f"`{each}`" for each in words)
    if "prefixItems" in node:
        return f"[{', '.join(takes(each) for each in node['prefixItems'])}]"
    if node.get("type") == "array":
        many = f" {node['minItems']}" if "maxItems" in node else ""
        return f"list of{many} {takes(node['items'])}"
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
    **dict.fromkeys(("Apiece", "Shared", "Listed"), EACH),
    "Anchoring": "{scale: c, rate: γ}",
    "Observed": "{honest: α, liar: α}",
    "NearestSources": "{nearest: n}",
    "Samples": "{samples: […]}",
    "ShareOfLinks": "{share: s, seed: n}",
    "ShareOfVehicles": "{share: s}",
    "WorstLanes": "{worst: K}",
    "ChosenVehicles": "{choose: n}",
    "BoundsByOrder": "list of list of 2 number",
    "Table": "a list of lists",
    "EachPosition": "a list of places",
    "EachVehicle": "a list of draws",
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
    if isinstance(value, int) and value.bit_count() == 1 and value > 2**20:
        return f"2^{value.bit_length() - 1}"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
