"""Break one line at a time and see whether a test notices.

A program draws the lines: the same number in each room of `jaxnet/`, from the bodies of functions,
with a fixed seed. A mutant swaps an operator, moves a number, or negates a condition. A mutant is
caught if a test of `make test` fails or takes too long. Tests run in order of likely relevance,
until the first failure: those that name the module, those of its room, all others.

Run it with `python experiments/mutants.py --count 60 --out results/mutants.csv`. The checkout is
copied and never changed. Each result is stored at once; a second run goes on where the first ended.
A mutant that tests of its room catch takes some 6 to 30 s, one that nobody catches as long as all
tests. `--last room` leaves the others out.
"""

import ast
import copy
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import click
import pandas as pd

ROOT = Path(__file__).parents[1]
STAGES = ["module", "room", "all"]  # tests that name the module, those of its room, all others
COLUMNS = ["file", "line", "change", "caught by", "seconds"]
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
# Neither messages of errors nor types; text with fields has no places of its own.
LEFT_ALONE = (ast.Raise, ast.Assert, ast.FunctionDef, ast.AnnAssign, ast.JoinedStr)


def places(tree: ast.Module) -> Iterator[ast.expr]:
    """Expressions in bodies of functions that `broken` can change."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                yield from parts(statement)


def parts(node: ast.AST) -> Iterator[ast.expr]:
    if isinstance(node, LEFT_ALONE):
        return
    if isinstance(node, ast.If | ast.While):
        yield node.test
    elif isinstance(node, ast.expr) and broken(node):
        yield node
    for child in ast.iter_child_nodes(node):
        yield from parts(child)


def broken(node: ast.expr) -> tuple[ast.expr, str] | None:
    """The node with another operator or number, and the change; None if it has neither."""
    other = copy.deepcopy(node)
    if isinstance(other, ast.BinOp | ast.BoolOp) and type(other.op) in SWAPS:
        old, new = type(other.op), SWAPS[type(other.op)]
        other.op = new()  # type: ignore[assignment]
    elif isinstance(other, ast.Compare) and type(other.ops[0]) in SWAPS:
        old, new = type(other.ops[0]), SWAPS[type(other.ops[0])]
        other.ops[0] = new()  # type: ignore[assignment]
    elif isinstance(other, ast.Constant) and type(other.value) in (int, float):
        other.value = other.value + 1  # type: ignore[operator]
        return other, f"{ast.unparse(node)} to {other.value}"
    else:
        return None
    return other, f"{old.__name__} to {new.__name__} in {ast.unparse(node)[:80]}"


def mutant(text: str, number: int) -> tuple[str, int, str]:
    """Text with one place changed, its line, and the change. The rest stays as it is."""
    node = list(places(ast.parse(text)))[number]
    negated = ast.UnaryOp(ast.Not(), node), f"not ({ast.unparse(node)[:80]})"
    other, change = broken(node) or negated
    source, starts = text.encode(), [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    begin = starts[node.lineno - 1] + node.col_offset
    end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
    changed = source[:begin] + f"({ast.unparse(other)})".encode() + source[end:]
    return changed.decode(), node.lineno, change


def drawn(count: int, seed: int, only: str) -> Iterator[tuple[Path, int]]:
    """Files and numbers of places in them, room after room."""
    chance = random.Random(seed)
    rooms = sorted(path for path in (ROOT / "jaxnet").iterdir() if (path / "__init__.py").exists())
    rooms = [room for room in rooms if only in ("", room.name)]
    found = {
        room: [
            (path, number)
            for path in sorted(room.rglob("*.py"))
            for number, _ in enumerate(places(ast.parse(path.read_text())))
        ]
        for room in rooms
    }
    for index in range(count):
        yield chance.choice(found[rooms[index % len(rooms)]])


def stages(path: Path) -> dict[str, list[str]]:
    """Files of tests in order of likely relevance, by stage."""
    home, stem = path.relative_to(ROOT / "jaxnet").parts[:-1], path.stem
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    package, _, last = module.rpartition(".")
    scores: dict[str, tuple[int, ...]] = {}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        folders, text = file.relative_to(ROOT / "tests").parts[:-1], file.read_text()
        shared = sum(home[: n + 1] == folders[: n + 1] for n in range(len(home)))
        shared += not folders and home[0] in file.stem  # test_api of the room api
        named = module in text or f"from {package} import {last}" in text or stem in file.stem
        mentions = text.count(package), text.count(home[0])
        scores[str(file.relative_to(ROOT))] = (named, shared, *mentions)
    order = sorted(scores, key=lambda file: scores[file], reverse=True)
    by: dict[str, list[str]] = {stage: [] for stage in STAGES}
    for file in order:
        named, shared, *_ = scores[file]
        by["module" if named and shared else "room" if named or shared else "all"].append(file)
    return by


def noticed(folder: Path, tests: list[str], workers: str, limit: float) -> str:
    """How tests notice: "failed" (or not collected), "time" (too long), "" if they do not."""
    if not tests:
        return ""
    options = ["-x", "-q", "-n", workers, "-m", "not long", "-p", "no:cacheprovider"]
    programs = str(ROOT / ".pytest_cache" / "programs")
    given = {"JAX_COMPILATION_CACHE_DIR": programs, **os.environ, "PYTHONPATH": str(folder)}
    run = subprocess.Popen(
        [sys.executable, "-m", "pytest", *options, *tests],
        cwd=folder,
        env=given,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        text=True,
    )
    try:
        output, _ = run.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return "time"
    if run.returncode == 4:  # a wrong option or path
        raise click.ClickException(f"pytest ended with 4: {output[-500:]}")
    return "" if run.returncode in (0, 5) else "failed"  # 5: every test is long


@click.command()
@click.option("--count", default=60, show_default=True, help="Mutants.")
@click.option("--seed", default=0, show_default=True)
@click.option("--room", default="", help="Mutants of one room of jaxnet/ alone.")
@click.option("--last", type=click.Choice(STAGES), default="all", help="Last stage of tests.")
@click.option("--workers", default="auto", show_default=True, help="Processes for the last stage.")
@click.option("--limit", default=1200.0, show_default=True, help="Seconds for a stage.")
@click.option("--out", type=Path, default=Path("results/mutants.csv"), show_default=True)
def main(
    count: int, seed: int, room: str, last: str, workers: str, limit: float, out: Path
) -> None:
    """Count the mutants that tests catch."""
    rows = pd.read_csv(out, keep_default_na=False).to_numpy().tolist() if out.exists() else []
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder) / "checkout"
        left_out = shutil.ignore_patterns(".venv", "results", ".git", ".pytest_cache")
        shutil.copytree(ROOT, there, ignore=left_out)
        for index, (path, number) in enumerate(drawn(count, seed, room)):
            text, line, change = mutant(path.read_text(), number)
            key, began = [str(path.relative_to(ROOT)), line, change], time.monotonic()
            if index < len(rows):
                if rows[index][:3] != key:
                    raise click.ClickException(f"{out} is of another checkout, seed or room")
                continue
            (there / key[0]).write_text(text)
            by, tests = "none", stages(path)
            for stage in STAGES[: STAGES.index(last) + 1]:
                processes = workers if stage == "all" else "0"
                if how := noticed(there, tests[stage], processes, limit):
                    by = stage if how == "failed" else f"{stage}, by time"
                    break
            shutil.copy(path, there / key[0])
            rows.append([*key, by, round(time.monotonic() - began, 1)])
            print(*rows[-1], flush=True)
            pd.DataFrame(rows, columns=COLUMNS).to_csv(out, index=False)
    caught = sum(row[3] != "none" for row in rows)
    print(f"{caught} of {len(rows)} caught; see {out}")


if __name__ == "__main__":
    main()
