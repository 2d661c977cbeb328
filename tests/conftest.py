"""Tests run strictly: double precision, no silent promotion, shapes and types checked."""

import gc
import os
import shutil
from pathlib import Path

# Matrices are small: threads of BLAS would only wait for each other. Workers of xdist inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")

os.environ.setdefault("JAX_ENABLE_X64", "true")
os.environ.setdefault("JAX_NUMPY_DTYPE_PROMOTION", "strict")
os.environ.setdefault("JAX_NUMPY_RANK_PROMOTION", "raise")

# Programs are many and their lanes few: unoptimised they compile four times as fast, and every
# bound of accuracy holds all the same. What users run is optimised, and one test in
# tests/runs/test_run.py runs it so. Nor is one cut into parts that are compiled side by side, for
# the other core has tests of its own.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    " --xla_cpu_parallel_codegen_split_count=1",
)

# A sixth of a program's time would go into where in the code its operations come from.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")

# What one process has compiled serves the others, and the next run.
os.environ.setdefault(
    "JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache" / "programs")
)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # the same goes for Python's, a command's too

import functools
import inspect
import typing

import jax
import jaxtyping
import numpy as np
import pytest
from hypothesis import settings

with_shapes = jaxtyping.jaxtyped


def checked(function=None, *, typechecker):
    """Make a function's or class's annotations hold, in less time than jaxtyping's own decorator.

    jaxtyping's decorator binds the arguments and checks them twice, in every call. Shapes need the
    binding alone, and functions without arrays need neither. Names in quotes are left to jaxtyping.
    """
    if function is None:
        return functools.partial(checked, typechecker=typechecker)
    if inspect.isclass(function) or inspect.isgeneratorfunction(function):
        return with_shapes(function, typechecker=typechecker)
    notes = function.__annotations__  # beartype knows Self only where it decorates the class
    for name in [name for name, note in notes.items() if typing.Self in parts_of(note)]:
        del notes[name]
    parts = [part for note in notes.values() for part in parts_of(note)]
    if any(isinstance(part, str | typing.ForwardRef) for part in parts):
        return with_shapes(function, typechecker=typechecker)
    arrays = any(getattr(part, "__module__", "").startswith("jaxtyping") for part in parts)
    return with_shapes(typechecker(function), typechecker=None) if arrays else typechecker(function)


def parts_of(note):
    """Yield an annotation and all annotations inside it."""
    yield note
    for inner in note if isinstance(note, list) else typing.get_args(note):
        yield from parts_of(inner)


if "JAXNET_CHECK_SHAPES" in os.environ:  # a quarter of the time of all tests
    jaxtyping.jaxtyped = checked
    # PEP 484: where a float is asked for, a whole number does.
    conf = "beartype.BeartypeConf(is_pep484_tower=True)"
    jaxtyping.install_import_hook("jaxnet", f"beartype.beartype(conf={conf})")

settings.register_profile("jaxnet", deadline=None, max_examples=40, derandomize=True)
settings.load_profile("jaxnet")

gc.set_threshold(200_000, 50, 1000)  # programs are traced into millions of objects, which stay

ROOM = 601  # output times; 30 s by default are 301
# XLA would look seventeen times for what can leave a loop, and verify what it has after each pass:
# half of the time to compile.
COSTLY = "simplify-while-loops,while-loop-invariant-code-motion,while-loop-constant-sinking"
COSTLY += ",hlo-verifier"
MOST_LINKS = 400  # of fleets for whom all series are saved
MOST_MAPPINGS = 35_000  # of memory; a file of tests adds some thousands
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


@pytest.fixture(scope="session", autouse=True)
def few_side_by_side():
    """Tests have few lanes, and those that fill a chunk up would be simulated too."""
    import jaxnet.engine.methods  # noqa: F401 (adds the family of engines)
    from jaxnet.engine import programs
    from jaxnet.engine.metrics import SERIES, VEHICLE_ERRORS
    from jaxnet.kinds import registry

    advance = programs.advance_load

    def in_much_room(plan, arguments, device):
        """Horizons share a program, with room for more output times than there are.

        So do runs and replays, whatever they save; tests of the engine do without inputs.
        """
        save, links = plan.save, arguments[0].hearing.sources.size
        if ("state" in save) == ("inputs" in save) and {*SERIES} & {*save} and links <= MOST_LINKS:
            save = (*SERIES, *VEHICLE_ERRORS)
        rows = -(-plan.rows // ROOM) * ROOM
        outcome = advance(plan._replace(rows=rows, save=save), arguments, device)
        saved = {name: np.asarray(outcome.series[name]) for name in plan.save}
        cut = {name: each[: plan.rows] for name, each in saved.items() if name in SERIES}
        return outcome._replace(series=saved | cut)

    cpu = programs.COMPILER["cpu"]
    passes = f"{cpu['xla_disable_hlo_passes']},{COSTLY}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(programs.COMPILER, "cpu", cpu | {"xla_disable_hlo_passes": passes})
        patch.setattr(programs, "advance_load", in_much_room)
        for engine, lanes in {"exact": 16, "nonlinear": 8, "sampled": 8}.items():
            patch.setattr(registry.find("engine", engine), "chunk", lanes)
        if "JAXNET_CHECK_SHAPES" in os.environ:  # shapes are checked in tracing
            patch.setattr("jaxnet.engine.programs.description_of", lambda *given: None)
        yield


@pytest.fixture(scope="module", autouse=True)
def few_programs_at_once():
    """Forget compiled programs before a process has Linux's greatest number of mappings, 65,530."""
    yield
    mappings = Path("/proc/self/maps")
    if mappings.exists() and mappings.read_text().count("\n") > MOST_MAPPINGS:
        from jaxnet.engine import programs

        programs.compiled.cache_clear()
        programs.jitted.cache_clear()
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def traced_anew(monkeypatch):
    """Programs are traced from the code as the test patches it, and their traces are not kept."""
    from jaxnet.engine import programs

    monkeypatch.setattr(programs, "trace_file", lambda described: None)
    programs.compiled.cache_clear()
    programs.jitted.cache_clear()
    yield
    programs.compiled.cache_clear()
    programs.jitted.cache_clear()


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the figures that a report writes."""
    from jaxnet.view.figures import every

    monkeypatch.setattr(every, "draw_figures", lambda *_, **__: iter(()))


@pytest.fixture(scope="module")
def many_side_by_side(few_side_by_side):
    """Where tests have hundreds of lanes a cell, most of the time would go into calls for a few."""
    from jaxnet.kinds import registry

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry.find("engine", "exact"), "chunk", 128)
        yield


@pytest.fixture(scope="module")
def browser():
    """A Chromium that is told to ask nobody for anything."""
    if BROWSER is None:
        pytest.skip("no Chromium is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        chromium = driver.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--disable-background-networking"]
        )
        yield chromium
        chromium.close()


def pytest_sessionfinish():
    """The last collection of garbage need not look through the traces of all programs."""
    gc.freeze()
