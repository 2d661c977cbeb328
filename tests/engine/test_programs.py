"""Programs are traced once, for all processes that run the same code."""

import os
import re

import jax
import numpy as np
import pytest

import jaxnet
from jaxnet.engine import batch, programs
from jaxnet.lanes.uniforms import bits
from tests import systems

pytestmark = pytest.mark.skipif(
    "JAXNET_CHECK_SHAPES" in os.environ, reason="shapes are checked in tracing: no trace is kept"
)

SHORT = {"horizon": 1.0, "tail": 0.5}
OWN = """
from jaxnet.kinds.metrics import Metric
farthest = Metric("farthest", "m", lambda seen: seen.errors(), "tail", "max", "max")
"""


@pytest.fixture
def folder(tmp_path):
    """A folder of compiled programs of one's own."""
    before = jax.config.values["jax_compilation_cache_dir"]
    bits()
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    programs.compiled.cache_clear()
    yield tmp_path / "traces"
    programs.compiled.cache_clear()
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def traces(monkeypatch):
    """One entry or more for each time that an engine is traced."""
    count, materialised = [], programs.xla.materialised
    monkeypatch.setattr(
        programs.xla, "materialised", lambda work: count.append(1) or materialised(work)
    )
    return count


def outcome(**keys):
    """Of two lanes, as another process finds it, which has no program yet."""
    programs.compiled.cache_clear()
    programs.jitted.cache_clear()
    return batch.simulate(lanes_of(**keys))


@pytest.fixture
def idle(monkeypatch):
    """Programs that do nothing, for which trace is kept does not depend on what is traced."""
    monkeypatch.setattr(programs, "jitted", lambda *_: jax.jit(lambda *leaves: leaves[0]))


def lanes_of(**keys):
    return systems.lanes(systems.study(**SHORT, **keys), 2, ())


def prepared(one):
    """The plan, and the structure and shapes of a program's arguments."""
    plan, capacity = batch.EVERYTHING.load_of(one.plan, one.network, one.size)
    arguments = one.network, one.clock, batch.queue_of(one.inputs, capacity), one.size
    return plan, *programs.taken_apart(arguments)[1:]


def compile_anew(one):
    """Compile as another process does, which has no program yet."""
    programs.compiled.cache_clear()
    device = batch.EVERYTHING.each()[0]
    with programs.computing_on(device):
        programs.compiled(*prepared(one), device)


def same(first, second):
    jax.tree.map(np.testing.assert_array_equal, first, second)


@pytest.mark.parametrize("engine", ["exact", pytest.param("nonlinear", marks=pytest.mark.long)])
def test_another_process_takes_the_trace_and_finds_the_same_bits(folder, traces, engine):
    first = outcome(engine=engine)
    assert len(list(folder.iterdir())) == 1
    traces.clear()
    same(first, outcome(engine=engine))
    assert not traces


def test_a_program_that_calls_the_host_is_traced_in_each_process(folder):
    """As diffrax does in the stacked engine."""
    found = outcome(engine="stacked", defence="none")
    assert (found.status == 0).all()
    assert not folder.exists()


def test_what_a_program_depends_on_has_a_trace_of_its_own(folder, idle, monkeypatch):
    """The plan, shapes, the package's code, JAX's settings."""
    compile_anew(lanes_of(engine="exact"))
    compile_anew(lanes_of(engine="exact", defence="none"))
    compile_anew(lanes_of(engine="exact", vehicles=5))
    assert len(list(folder.iterdir())) == 3
    monkeypatch.setattr(programs, "own_code", lambda: b"changed")
    compile_anew(lanes_of(engine="exact"))
    assert len(list(folder.iterdir())) == 4
    jax.config.update("jax_default_matmul_precision", "float32")
    try:
        compile_anew(lanes_of(engine="exact"))
    finally:
        jax.config.update("jax_default_matmul_precision", None)
    assert len(list(folder.iterdir())) == 5


def test_numbers_share_a_trace(folder, idle):
    compile_anew(lanes_of(engine="exact", attack={"kind": "bias", "magnitude": 1.0}))
    other = {"attack": {"kind": "bias", "magnitude": 2.0}, "gain": [2, 4, 4]}
    compile_anew(lanes_of(engine="exact", **other))
    assert len(list(folder.iterdir())) == 1


def test_code_from_outside_is_traced_in_each_process(folder, idle, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    file = tmp_path / "study.yaml"
    file.write_text("name: own\nengine: exact\nhorizon: 1\ntail: 0.5\nmetrics: [own:farthest]\n")
    compile_anew(systems.lanes(jaxnet.load(file), 2, ()))
    assert not folder.exists()


@pytest.mark.parametrize("content", [b"", b"torn", bytes(200)])
def test_a_torn_trace_is_written_again(folder, idle, content):
    one = lanes_of(engine="exact")
    compile_anew(one)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] + content)
    assert programs.read_trace(file) is None
    compile_anew(one)
    assert programs.read_trace(file) is not None


def test_a_folder_that_cannot_be_written_costs_no_lane(folder, idle):
    folder.write_text("a file, where the folder is due")
    compile_anew(lanes_of(engine="exact"))


@pytest.mark.parametrize(
    "keys",
    [
        pytest.param({"engine": "exact"}, marks=pytest.mark.long),
        pytest.param({"engine": "exact", "defence": "none"}, marks=pytest.mark.long),
        {"engine": "exact", "channel": {"loss": {"kind": "bernoulli", "probability": 0.1}}},
        pytest.param({"engine": "nonlinear"}, marks=pytest.mark.long),
    ],
)
def test_loops_are_compiled_as_one_function(keys):
    """A sort or a scatter in a loop would have it run operation by operation: 1.2 times as long."""
    plan, structure, shapes = prepared(lanes_of(**keys))
    with programs.computing_on(batch.EVERYTHING.each()[0]):
        text = programs.jitted(plan, structure).lower(*shapes).compile().as_text()
    assert " while(" in text
    assert not re.findall(r" (?:sort|scatter)\(", text)
