"""What holds for the project as a whole: imports run one way, configs run, the schema is current."""

import ast
import json
from pathlib import Path

import jsonschema
import pytest
import yaml

import jaxnet
from jaxnet.config.document import Document
from jaxnet.config.schema import schema_text

ROOT = Path(__file__).parents[1]
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))

# Each room may import itself and the rooms before it (docs/architecture.md).
ROOMS = [
    *("model", "kinds", "theory", "engine", "config", "lanes", "store", "statistics", "runs"),
    *("view", "api", "cli"),
]


def room(module: str) -> str:
    """The part of the package that a module belongs to."""
    return module.split(".")[1] if "." in module else ""


@pytest.mark.parametrize("path", sorted((ROOT / "jaxnet").rglob("*.py")), ids=lambda path: path.stem)
def test_imports_run_one_way(path):
    """From every room to those before it, never back."""
    ours = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    home = room(ours)
    if home not in ROOMS:
        return
    for node in ast.walk(ast.parse(path.read_text())):
        modules = []
        if isinstance(node, ast.ImportFrom) and node.module:
            modules = [node.module, *(f"{node.module}.{name.name}" for name in node.names)]
        elif isinstance(node, ast.Import):
            modules = [name.name for name in node.names]
        for module in modules:
            if module.startswith("jaxnet.") and room(module) in ROOMS:
                assert ROOMS.index(room(module)) <= ROOMS.index(home), f"{ours} imports {module}"


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_config_loads_and_says_how_it_is_run(path):
    """Its first line is the command that runs it, and its name is the file's."""
    first, second = path.read_text().splitlines()[:2]
    assert first == f"# jaxnet run configs/{path.name}"
    assert second == "# yaml-language-server: $schema=schema.json"
    assert jaxnet.load(path).config.name == path.stem


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_config_fits_the_schema(path):
    """As an editor would check it; a misspelt key does not fit."""
    schema, data = json.loads(schema_text()), Document.read(path).data
    jsonschema.validate(data, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(data | {"horizn": 3}, schema)


def test_the_schema_beside_the_configs_is_current():
    """`jaxnet schema > configs/schema.json`."""
    assert (ROOT / "configs" / "schema.json").read_text() == schema_text()


def test_the_stored_study_fits_the_schema(tmp_path):
    """With every default written out."""
    from jaxnet.config.cells import plain

    study = jaxnet.load(ROOT / "configs" / "paper.yaml")
    text = yaml.safe_dump(plain(study.config))
    jsonschema.validate(Document(text, "study.yaml").data, json.loads(schema_text()))


def test_paper_config_is_the_designs_example():
    """Three topologies by two magnitudes, star first."""
    study = jaxnet.load(ROOT / "configs" / "paper.yaml")
    assert [tuple(cell.labels.values()) for cell in study.cells] == [
        (topology, magnitude) for topology in ("star", "cyclic", "path") for magnitude in (0, 5)
    ]
