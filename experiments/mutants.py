"""Break one line at a time and see whether a test notices.

A program draws the lines: the same number in each room of `jaxnet/`, from the bodies of functions,
with a fixed seed. A mutant swaps an operator, moves a number, or negates a condition. A mutant is
caught if `make test`'s tests fail: first those of its room, then all of them.

Run it on a clean checkout with `python experiments/mutants.py --count 60 --out results/mutants.csv`
(hours; the checkout is copied, and never changed).
"""

import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import click
import pandas as pd

ROOT = Path(__file__).parents[1]
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Add,
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
TYPES_ONLY = (ast.Raise, ast.Assert, ast.FunctionDef, ast.AnnAssign, ast.Import, ast.ImportFrom)


def places(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes in bodies of functions that `broken` can change; not messages of errors, not types."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                yield from parts(statement)


def parts(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, TYPES_ONLY):
        return
    known = (
        (isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPS)
        or (isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS)
        or (isinstance(node, ast.Constant) and type(node.value) in (int, float))
        or isinstance(node, ast.If)
    )
    if known:
        yield node
    for child in ast.iter_child_nodes(node):
        yield from parts(child)


def broken(node: ast.AST) -> str:
    """Change a node in place; say how."""
    if isinstance(node, ast.BinOp | ast.BoolOp):
        old, node.op = node.op, SWAPS[type(node.op)]()  # type: ignore[assignment]
        return f"{type(old).__name__} to {type(node.op).__name__}"
    if isinstance(node, ast.Compare):
        old, node.ops[0] = node.ops[0], SWAPS[type(node.ops[0])]()  # type: ignore[assignment]
        return f"{type(old).__name__} to {type(node.ops[0]).__name__}"
    if isinstance(node, ast.If):
        node.test = ast.UnaryOp(ast.Not(), node.test)
        return "condition negated"
    assert isinstance(node, ast.Constant)
    old, node.value = node.value, node.value + 1  # type: ignore[operator]
    return f"{old} to {node.value}"


def drawn(count: int, seed: int) -> Iterator[tuple[Path, int]]:
    """Files and numbers of places in them, room after room."""
    chance = random.Random(seed)
    rooms = sorted(path for path in (ROOT / "jaxnet").iterdir() if (path / "__init__.py").exists())
    for index in range(count):
        room = rooms[index % len(rooms)]
        found = [
            (path, number)
            for path in sorted(room.rglob("*.py"))
            for number, _ in enumerate(places(ast.parse(path.read_text())))
        ]
        yield chance.choice(found)


def fails(copy: Path, tests: list[str]) -> bool:
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-m",
        "not long",
        "-p",
        "no:cacheprovider",
    ]
    run = subprocess.run(
        [*command, *tests],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
    )
    if run.returncode not in (0, 1):
        raise click.ClickException(f"pytest ended with {run.returncode}: {run.stdout[-500:]}")
    return run.returncode == 1


@click.command()
@click.option("--count", default=60, show_default=True, help="Mutants.")
@click.option("--seed", default=0, show_default=True)
@click.option("--out", type=Path, default=Path("results/mutants.csv"), show_default=True)
def main(count: int, seed: int, out: Path) -> None:
    """Count the mutants that tests catch."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "checkout"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".venv", "results", ".git"))
        for path, number in drawn(count, seed):
            there = copy / path.relative_to(ROOT)
            whole = there.read_text()
            tree = ast.parse(whole)
            node = list(places(tree))[number]
            line, how = getattr(node, "lineno", 0), broken(node)
            there.write_text(ast.unparse(tree))
            room = path.relative_to(ROOT / "jaxnet").parts[0]
            own = copy / "tests" / room
            by = "none"
            if own.exists() and fails(copy, [str(own)]):
                by = room
            elif fails(copy, []):
                by = "all"
            there.write_text(whole)
            rows.append((str(path.relative_to(ROOT)), line, how, by))
            print(*rows[-1], flush=True)
    table = pd.DataFrame(rows, columns=["file", "line", "change", "caught by"])
    out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(out, index=False)
    caught = sum(by != "none" for *_, by in rows)
    print(f"{caught} of {len(table)} caught; wrote {out}")


if __name__ == "__main__":
    main()
