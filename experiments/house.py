"""How readable the package is: one table of counts, room by room.

Run it with `python experiments/house.py`; with `--names` for the names that stand in several
modules, with `--where ROOM` for the places in a room that the table counts.
"""

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import click

PACKAGE = Path(__file__).parents[1] / "jaxnet"
FEW_WORDS = 3
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Module(NamedTuple):
    """A parsed file of the package."""

    path: Path  # below the package
    tree: ast.Module

    @property
    def room(self) -> str:
        """The folder, or the file where it lies beside the folders."""
        return self.path.parts[0]

    @property
    def lines(self) -> int:
        """Lines of its text."""
        return len((PACKAGE / self.path).read_text().splitlines())

    def functions(self) -> list[Function]:
        """Every function and method."""
        return [node for node in ast.walk(self.tree) if isinstance(node, Function)]


def modules() -> list[Module]:
    """All files of the package."""
    files = sorted(PACKAGE.rglob("*.py"))
    return [Module(file.relative_to(PACKAGE), ast.parse(file.read_text())) for file in files]


def says_any(function: Function) -> bool:
    """Whether an annotation of the signature has the name Any in it."""
    given = function.args
    each = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    notes = [one.annotation for one in each if one is not None] + [function.returns]
    return any(
        isinstance(node, ast.Name) and node.id == "Any"
        for note in notes
        if note
        for node in ast.walk(note)
    )


def late_imports(module: Module) -> list[int]:
    """Lines of imports that stand inside functions."""
    found = {
        node.lineno
        for function in module.functions()
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    return sorted(found)


def top_names(module: Module) -> Iterator[str]:
    """Names that a module defines, not those that it imports."""
    for node in module.tree.body:
        if isinstance(node, Function | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign):
            yield from (one.id for one in node.targets if isinstance(one, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def in_several(known: list[Module]) -> dict[str, list[Path]]:
    """Names that stand in two modules or more, and where."""
    places = defaultdict[str, list[Path]](list)
    for module in known:
        for name in set(top_names(module)):
            places[name].append(module.path)
    return {
        name: where
        for name, where in sorted(places.items())
        if len(where) > 1 and not name.startswith("__")
    }


def short_docstrings(module: Module) -> list[int]:
    """Lines of definitions whose docstring has few words."""
    defined = (node for node in ast.walk(module.tree) if isinstance(node, Function | ast.ClassDef))
    return [
        node.lineno
        for node in defined
        if 0 < len((ast.get_docstring(node) or "").split()) <= FEW_WORDS
    ]


@click.command()
@click.option("--names", is_flag=True, help="Print the names that stand in several modules.")
@click.option("--where", help="Print the places in this room.")
def main(names: bool, where: str | None) -> None:
    """Print the table."""
    known = modules()
    several = in_several(known)
    if names:
        for name, places in several.items():
            print(f"{name:24}{', '.join(map(str, places))}")
        return
    if where:
        for module in known:
            if module.room == where:
                print(
                    *(
                        f"{module.path}:{one.lineno} Any {one.name}"
                        for one in module.functions()
                        if says_any(one)
                    ),
                    *(f"{module.path}:{line} import" for line in late_imports(module)),
                    *(f"{module.path}:{line} short docstring" for line in short_docstrings(module)),
                    sep="\n",
                )
        return
    rooms = dict.fromkeys(module.room for module in known)
    print(
        f"{'room':14}{'lines':>8}{'signatures':>12}{'Any %':>8}"
        f"{'late':>6}{'doubled':>9}{'short':>7}"
    )
    for room in [*rooms, "all"]:
        these = [module for module in known if room in ("all", module.room)]
        functions = [one for module in these for one in module.functions()]
        paths = {module.path for module in these}
        doubled = sum(bool(paths & {*places}) for places in several.values())
        share = 100 * sum(map(says_any, functions)) / max(1, len(functions))
        lines = sum(module.lines for module in these)
        late, short = (
            sum(len(of(each)) for each in these) for of in (late_imports, short_docstrings)
        )
        print(f"{room:14}{lines:8,}{len(functions):12,}{share:8.1f}{late:6}{doubled:9}{short:7}")


if __name__ == "__main__":
    main()
