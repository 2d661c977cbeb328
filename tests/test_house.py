"""What holds for the whole project: imports run one way, configs run, the schema is current."""

import ast
import importlib
import json
import pkgutil
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from typing import Any

import jsonschema
import pytest
import yaml

import jaxnet
from jaxnet.config.cells import to_plain
from jaxnet.config.document import Document
from jaxnet.config.keys import KINDS
from jaxnet.config.schema import schema_text
from jaxnet.kinds import kind, registry
from jaxnet.kinds.kind import Kind
from jaxnet.outside.families import FAMILIES, base_of

ROOT = Path(__file__).parents[1]
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))
MODULES = sorted((ROOT / "jaxnet").rglob("*.py"))

# Each room may import itself and the rooms before it (docs/architecture.md).
ROOMS = "model solvers outside networks kinds engine config theory lanes store statistics"
ROOMS = [*ROOMS.split(), "runs", "explore", "view", "film", "viewer", "api", "cli"]
ROOT_NAMES = {"jaxnet", "jaxnet.__version__", *(f"jaxnet.{name}" for name in jaxnet.__all__)}


def room(module: str) -> str:
    """The part of the package that a module belongs to."""
    return module.split(".")[1] if "." in module else ""


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_imports_run_one_way(path):
    """Each room imports itself and earlier rooms; rooms before `api` never the package's root."""
    ours = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    home = room(ours)
    if home not in ROOMS or ours == "jaxnet.kinds.protocols":  # which imports types alone
        return
    for node in ast.walk(ast.parse(path.read_text())):
        modules = []
        if isinstance(node, ast.ImportFrom) and node.module:
            modules = [f"{node.module}.{name.name}" for name in node.names]
            modules += [node.module] if node.module != "jaxnet" else []
        elif isinstance(node, ast.Import):
            modules = [name.name for name in node.names]
        for module in modules:
            if ROOMS.index(home) < ROOMS.index("api"):
                assert module not in ROOT_NAMES, f"{ours} imports the package's root"
            if module.startswith("jaxnet.") and room(module) in ROOMS:
                assert ROOMS.index(room(module)) <= ROOMS.index(home), f"{ours} imports {module}"


@pytest.fixture(scope="module")
def schema() -> jsonschema.Draft202012Validator:
    """The schema, which is one."""
    jsonschema.Draft202012Validator.check_schema(json.loads(schema_text()))
    return jsonschema.Draft202012Validator(json.loads(schema_text()))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_config_loads_and_says_how_it_is_run(path, schema):
    """Its first line is the command that runs it; it fits the schema, a misspelt key does not."""
    first, second = path.read_text().splitlines()[:2]
    study = jaxnet.load(path).config
    assert first == f"# jaxnet {'search' if study.search else 'run'} configs/{path.name}"
    assert second == "# yaml-language-server: $schema=schema.json"
    assert study.name == path.stem
    data = Document.read(path).data
    schema.validate(data)
    with pytest.raises(jsonschema.ValidationError):
        schema.validate(data | {"horizn": 3})


def test_the_schema_beside_the_configs_is_current():
    """`jaxnet schema > configs/schema.json`."""
    assert (ROOT / "configs" / "schema.json").read_text() == schema_text()


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("attack: bias", True),
        ("attack: my_package.attacks:Chirp", True),
        ("attack: {kind: my_package.attacks:Chirp, whatever: 3}", True),
        ("attack: {magnitude: 3}", True),  # of the default
        ("attack: {kind: bias, direction: {uniform: [0, 1]}}", True),
        ("attack: {kind: envelope, of: {kind: bias, direction: 1}}", True),
        ("metrics: [min_separation, 'my_package:latency']", True),
        ("attack: bais", False),
        ("attack: {direction: 3}", False),  # the default has none
        ("attack: {kind: bias, directoin: 3}", False),
        ("attack: {kind: bias, magnitude: -1}", False),
        ("attack: {kind: envelope}", False),
        ("attack: {kind: envelope, of: {kind: bias, directoin: 1}}", False),
        ("engine: flat", False),
        ("metrics: [separation]", False),
    ],
)
def test_an_editor_sees_what_fits(text, fits, schema):
    """Names of kinds and their keys, inside others too; of a class from outside the name alone."""
    data = Document(f"name: x\n{text}\n", "x.yaml").data
    assert schema.is_valid(data) == fits


def test_an_editor_shows_what_each_key_means():
    """A kind's description and its keys with theirs, units and defaults, as the class says them."""
    given = json.loads(schema_text())["$defs"]
    assert given["Chirp"]["description"].startswith("`[cos, sin](ψ(t) + phase)`")
    assert given["Chirp"]["properties"]["rate"]["description"].startswith("[rad/s²], ")
    assert given["Chirp"]["properties"]["rate"]["default"] == 0.05
    assert {"enum": registry.kind_names("attack")} in given["attack"]["anyOf"]


def test_the_stored_study_fits_the_schema(schema):
    """With every default written out."""
    study = jaxnet.load(ROOT / "configs" / "paper.yaml")
    text = yaml.safe_dump(to_plain(study.config))
    schema.validate(Document(text, "study.yaml").data)


# --- kinds and rooms -----------------------------------------------------------------------------

# What all families share may look at types: it makes kinds, finds them and takes them apart.
SHARED = {"jaxnet.kinds.kind", "jaxnet.kinds.registry"}
HOMES = {family: found.package for family, found in FAMILIES.items()}


def name_of(path: Path) -> str:
    """The module of a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def home_of(module: str) -> str:
    """The folder of the family that a module belongs to, "" if to none."""
    return next((home for home in HOMES.values() if f"{module}.".startswith(f"{home}.")), "")


def imported(tree: ast.AST) -> dict[str, str]:
    """What the names that a module imports stand for, wherever it imports them."""
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {each.asname or each.name: f"{node.module}.{each.name}" for each in node.names}
        elif isinstance(node, ast.Import):
            names |= {each.asname: each.name for each in node.names if each.asname}
            names |= {each.name.split(".")[0]: each.name.split(".")[0] for each in node.names}
    return names


def meant(node: ast.AST, names: dict[str, str], module: str) -> Any:
    """The class that a name or attribute means, if it is a kind's."""
    dotted = ast.unparse(node)
    first, _, rest = dotted.partition(".")
    reference = names.get(first, f"{module}.{first}") + (f".{rest}" if rest else "")
    if not reference.startswith("jaxnet."):
        return None
    home, _, attribute = reference.rpartition(".")
    try:
        found = getattr(importlib.import_module(home), attribute, None)
    except ImportError:
        return None
    is_kind = isinstance(found, type) and issubclass(found, Kind) and found is not Kind
    return found if is_kind else None


def types_looked_at(tree: ast.AST) -> Iterator[ast.AST]:
    """The expressions that say by which types a module tells objects apart."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
            yield node.args[1]
        elif isinstance(node, ast.MatchClass):
            yield node.cls
        elif isinstance(node, ast.Compare):
            yield from (node.left, *node.comparators)


def names_a_kind(node: ast.AST) -> bool:
    """Whether a comparison or pattern asks for what a kind is called."""
    if isinstance(node, ast.MatchMapping):
        return any(isinstance(key, ast.Constant) and key.value == "kind" for key in node.keys)
    if not isinstance(node, ast.Compare):
        return False
    sides = [ast.unparse(each) for each in (node.left, *node.comparators)]
    asking = (".kind", "['kind']", ".reference()")
    called = any(s.endswith(asking) and not s.endswith("dtype.kind") for s in sides)
    words = (word.value for word in ast.walk(node) if isinstance(word, ast.Constant))
    return called and any(isinstance(word, str) and word != "kind" for word in words)


def asked(source: str, module: str) -> list[str]:
    """Where a module asks for the type or name of a kind of another folder."""
    tree = ast.parse(source)
    names, home, found = imported(tree), home_of(module), []
    for looked_at in types_looked_at(tree):
        for node in ast.walk(looked_at):
            if isinstance(node, ast.Name | ast.Attribute):
                known = meant(node, names, module)
                if known is not None and home_of(known.__module__) != home:
                    found.append(f"{module}:{node.lineno}: {ast.unparse(node)}")
    for node in ast.walk(tree):
        if names_a_kind(node) and not home:
            found.append(f"{module}:{getattr(node, 'lineno', 0)}: {ast.unparse(node)}")
    return found


@pytest.mark.parametrize(
    "path", [path for path in MODULES if name_of(path) not in SHARED], ids=lambda path: path.stem
)
def test_nobody_asks_for_the_type_of_a_kind(path):
    """Outside its family's folder a kind is asked what it does, not what it is."""
    assert asked(path.read_text(), name_of(path)) == []


@pytest.mark.parametrize(
    ("body", "finds"),
    [
        ("isinstance(one, Rotating)", True),
        ("isinstance(one, int | Attack)", True),
        ("issubclass(one, (int, attacks.Attack))", True),
        ("type(one) is Rotating", True),
        ("type(one) in (Rotating, int)", True),
        ("cell.attack.kind == 'bias'", True),
        ("cell.attack.kind in ('bias', 'rotating')", True),
        ("'bias' != given['kind']", True),
        ("engine.reference() == 'exact'", True),
        ("isinstance(one, Graph)", True),
        ("isinstance(one, Path)", False),  # pathlib's
        ("isinstance(one, Kind)", False),  # whether it is one at all
        ("values.dtype.kind in 'UO'", False),
        ("one.kind == other.kind", False),
        ("Rotating(magnitude=1.0)", False),
    ],
)
def test_asking_for_a_kinds_type_is_found(body, finds):
    """However it is written; not in the family's own folder."""
    source = dedent("""
        from pathlib import Path
        from jaxnet.kinds import attacks
        from jaxnet.kinds.attacks import Attack
        from jaxnet.kinds.attacks.rotating import Rotating
        from jaxnet.kinds.graphs import Graph
        from jaxnet.kinds.kind import Kind
    """)
    assert bool(asked(source + body, "jaxnet.view.figures.panels")) == finds
    for pattern in ("case Rotating(): 0", "case attacks.Attack(): 0", "case {'kind': 'bias'}: 0"):
        assert asked(f"{source}match one:\n    {pattern}", "jaxnet.view.figures.panels")
    at_home = "Graph" in body
    assert bool(asked(source + body, "jaxnet.kinds.attacks.bias")) == at_home


def test_no_room_holds_more_than_a_fifth_of_the_lines():
    """The command line and the interface count as one."""
    lines: Counter[str] = Counter()
    for path in MODULES:
        inside = path.relative_to(ROOT / "jaxnet").parts
        lines[inside[0] if len(inside) > 1 else "interface"] += len(path.read_text().splitlines())
    shares = {each: round(count / lines.total(), 3) for each, count in lines.most_common()}
    assert max(shares.values()) <= 0.2, shares


@pytest.mark.parametrize("family", FAMILIES)
def test_every_kind_of_ours_has_a_file_named_after_it(family, monkeypatch):
    """One kind a file; it is found, and stored, by that name, whatever was loaded before."""
    monkeypatch.setattr(registry, "entry_points", lambda family: [])
    monkeypatch.setattr(kind, "REFERENCES", {})
    package, base = importlib.import_module(FAMILIES[family].package), base_of(family)
    files = [module.name for module in pkgutil.iter_modules(package.__path__)]
    assert registry.kind_names(family) == files
    for name in files:
        module = importlib.import_module(f"{package.__name__}.{name}")
        here = [each for each in vars(module).values() if belongs(each, base, module)]
        found = registry.find(family, name)
        assert here == [found]
        assert (found.reference() if isinstance(found, type) else found.name) == name


def belongs(found: Any, base: type, module: Any) -> bool:
    """Whether a module defines a kind of a family: a class, or a metric."""
    if isinstance(found, type):
        return issubclass(found, base) and found.__module__ == module.__name__
    return isinstance(found, base)


def test_what_is_stored_does_not_depend_on_what_was_loaded_before(monkeypatch):
    """Defaults are stored by their short names too, so that two processes store the same study."""
    monkeypatch.setattr(kind, "REFERENCES", {})
    stored = to_plain(jaxnet.load({}).config)
    given = {family: stored[family]["kind"] for family in KINDS}
    assert to_plain(jaxnet.load(given | {"name": "study"}).config) == stored
    assert not any(":" in name for name in given.values()), given


# --- words ---------------------------------------------------------------------------------------

# Names of the interface that the modules behind it have too.
OF_THE_INTERFACE = {"Results", "simulate"}


def defined(tree: ast.Module) -> set[str]:
    """Public names that a module defines itself."""
    names = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return {name for name in names if not name.startswith("_")}


def test_a_top_level_name_stands_in_one_module():
    """A reader who finds a name knows what it is, wherever the name stands."""
    homes = defaultdict(set)
    for path in MODULES:
        for name in defined(ast.parse(path.read_text())):
            homes[name].add(name_of(path))
    several = {name: sorted(found) for name, found in homes.items() if len(found) > 1}
    assert {name: found for name, found in several.items() if name not in OF_THE_INTERFACE} == {}
    assert set(several) == OF_THE_INTERFACE, "no longer needs its exception"
