"""What commands do that need no JAX: a config, the list of results, files for other programs."""

import json
import shlex
from pathlib import Path
from string import Template

import click

import jaxnet
from jaxnet.cli.errors import echo
from jaxnet.config import cells, document
from jaxnet.config.schema import schema_text
from jaxnet.lazy import LazyModule
from jaxnet.store.folder import FolderError
from jaxnet.view.text import check as checks

folders = LazyModule("jaxnet.view.text.folders")  # reads Parquet, of which `check` needs nothing


def write_starter(file: Path) -> None:
    if file.exists():
        raise FolderError(f"{file} is there already: give another FILE")
    template = Template(Path(cells.__file__).with_name("starter.yaml").read_text(encoding="utf-8"))
    content = template.substitute(file=shlex.quote(str(file)), name=json.dumps(file.stem))
    cells.read_document(document.Document(content, str(file)))
    with file.open("x", encoding="utf-8") as opened:
        opened.write(content)
    echo(f"wrote {file}\nnext: jaxnet check {shlex.quote(str(file))}", err=True)


def check_study(config: Path, overrides: tuple[str, ...], cell: int | None) -> None:
    study = jaxnet.load(config, overrides)
    if cell is not None and cell >= len(study.cells):
        raise click.BadParameter(f"there are {len(study.cells)} cells", param_hint="--cell")
    if study.config.scope.known:  # classes from outside are tried, which takes JAX
        from jaxnet.engine.batch import EVERYTHING
        from jaxnet.runs.shards import try_kinds

        try_kinds(study.config, study.cells, EVERYTHING)
    echo(checks.check_text(study, cell))


def print_schema() -> None:
    echo(schema_text(), nl=False)


def print_folders(folder: str) -> None:
    if lines := folders.folders_text(folder):
        echo(lines)
    else:
        echo(f"no results in {folder}", err=True)


def export_results(results: str, chosen: dict[str, str]) -> None:
    opened = jaxnet.open(results)
    for form, out in chosen.items():
        echo(f"wrote {opened.export(out or None, form)}", err=True)
