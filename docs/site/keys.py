"""Write the lists of keys.md, from the schema and the kinds: `python docs/site/keys.py`."""

import inspect
import re
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from jaxnet.config.schema import DEFAULT_KINDS, NAME, config_schema
from jaxnet.kinds import registry

PAGE = Path(__file__).parents[1] / "keys.md"
MARK = "<!-- From here on written by docs/site/keys.py -->\n"
LIMITS = {
    "exclusiveMinimum": "> {}",
    "minimum": "≥ {}",
    "exclusiveMaximum": "< {}",
    "maximum": "≤ {}",
}
LIMITS["multipleOf"] = "a multiple of {}"
WORDS = {"integer": "integer", "boolean": "boolean", "string": "text", "null": "null"}
EACH = "[each](config.md#one-for-each-attacked-vehicle)"
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
    "file of topology": "[networks from files](config.md#networks-from-files)",
    "switching": "[switching networks](theorems.md#switching-networks)",
    "driven": "[navigator](model.md#navigator)",
    "none of navigator": "[without a navigator](model.md#without-a-navigator)",
    "spoof": "[O10](theorems.md#inconsistent-derivatives-o10)",
    "trust": "[trust that learns](trust.md)",
    "vote": "[theorem 7](guarantees.md#theorem-7-a-vote)",
    "trusted_trim": "[trimming](model.md#defence), [announcements](guarantees.md#announcements)",
    "linearised": "[the linearised law](model.md#the-linearised-law)",
    "local": "[the local law](model.md#the-local-law)",
    "rounds": "[rounds.md](rounds.md)",
    "gaussian of sensing": "[O13](theorems.md#sensor-errors-o13)",
    "gaussian of noise": "[O15](theorems.md#substituted-messages-o15)",
    "chi_squared": "[O17](theorems.md#alarms-o17)",
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
    families = ", ".join(f"[{family}](#{family})" for family in [*DEFAULT_KINDS, "metrics"])
    parts = [wrapped(f"Families of kinds: {families}."), "\n## Keys of a study\n"]
    parts += [section(title, rows(whole, keys.split()), 3) for title, keys in GROUPS.items()]
    parts += [section(key, rows(each, each["properties"])) for key, each in inner.items()]
    parts += [part for family in DEFAULT_KINDS for part in of_family(family, whole["$defs"])]
    parts += of_metrics(whole["$defs"])
    return "\n".join([prose + mark, *parts]) + "\n"


def of_family(family: str, known: dict[str, Any]) -> Iterator[str]:
    """The kinds of a family: an example, keys that most kinds have, then each with all its keys."""
    kinds = {name: registry.find(family, name) for name in registry.kind_names(family)}
    tables = {name: rows(known[kind.__name__], own(kind)) for name, kind in kinds.items()}
    having = Counter(row for table in tables.values() for row in table)
    shared = [row for row, number in having.items() if 2 * number > len(kinds) > 1]
    yield f"## {family}\n"
    if family in EXAMPLES:
        yield f"    {EXAMPLES[family]}\n"
    if shared:
        yield section(f"Shared keys of {family}", shared, 3)
    for name, kind in kinds.items():
        recurs = sum(name in registry.kind_names(other) for other in DEFAULT_KINDS) > 1
        title = f"`{name}`" + f" of {family}" * recurs
        table = [row for row in tables[name] if row not in shared]
        also = ", ".join(row.partition(" | ")[0] for row in tables[name] if row in shared)
        more = f"- [shared keys](#shared-keys-of-{family}): {also}" if also else ""
        yield section(title, table, 3, described(name, family, kind), more)


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


def own(kind: Any) -> list[str]:
    """The keys of a kind, but for those that all kinds have."""
    return [key for key in kind.model_fields if key not in ("kind", "label")]


def rows(model: Any, keys: Iterable[str]) -> list[str]:
    """Lines of a table for keys of a model, those that must be given first."""
    required = model.get("required", [])
    return [
        row(key, model["properties"][key], key in required)
        for key in sorted(keys, key=lambda key: key not in required)
    ]


def section(title: str, table: list[str], level: int = 2, words: str = "", more: str = "") -> str:
    """A heading, words, and a list of the keys, with more at its end."""
    keys = wrapped("\n".join(filter(None, [*map(listed, table), more])))
    return "\n\n".join(filter(None, [f"{'#' * level} {title}", words.rstrip(), keys])) + "\n"


def listed(line: str) -> str:
    """A row as an item of a list; what each choice means is an item below it."""
    key, taken, meaning = line.split(" | ")
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
    "ChangingVehicles": "[{at: […], sets: […]}](config.md#other-vehicles-from-given-times-on)",
    "EachOrder": "[one for each order](config.md#a-magnitude-for-each-order)",
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
