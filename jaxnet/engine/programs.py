"""Compiled programs, one for each plan, shape of arrays and device.

A program takes a load and advances it. Tracing an engine in Python takes longer than all the rest
of a short run. So a trace is kept, as StableHLO, beside JAX's compiled programs. Later processes
find it under a digest of all that it depends on: the package's code, its libraries, JAX's settings,
the plan, and the shapes. A trace of code from outside is not kept.
"""

import contextlib
import functools
import hashlib
import io
import os
import pickle
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import export

from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.model import xla
from jaxnet.model.lane import Network
from jaxnet.outside.modules import Origin

Arguments = tuple[Network, Clock, Inputs, Any]  # the last: the number of lanes of the load
ArrayShapes = Sequence[jax.ShapeDtypeStruct]

LIBRARIES = "jax", "jaxlib", "numpy", "equinox", "diffrax", "lineax", "optimistix"  # in traces
COMPILING = set[int]()  # threads that compile a program
ONE_AT_A_TIME = threading.Lock()  # threads that need the same program wait for it
# Compiler options by platform. The gains are measured on two cores. Wider vectors
# (`xla_cpu_prefer_vector_width` of 512) are left out: XLA 0.10.2 then computes arctan wrongly.
COMPILER = {
    "cpu": {
        # Loops for sums of few terms, not XLA's library: 1.5 times, trimming, 1,000 vehicles.
        "xla_cpu_experimental_ynn_fusion_type": "",
        # A long sum in one pass: 1.02 times, trimming, 12 vehicles. Else sums end in other bits.
        "xla_disable_hlo_passes": "tree_reduction_rewriter",
    }
}

export.register_namedtuple_serialization(Outcome, serialized_name="jaxnet.Outcome")


def advance_load(plan: Plan, arguments: Arguments, device: Any) -> Outcome:
    """The outcome of a load of lanes, the lanes last; inside `computing_on` this device."""
    leaves, structure, shapes = taken_apart(arguments)
    with ONE_AT_A_TIME:
        program = compiled(plan, structure, shapes, device)
    return program(*leaves)


def trace_program(plan: Plan, arguments: Arguments) -> None:
    """Trace a program with kinds from outside, which may break their contract."""
    _, structure, shapes = taken_apart(arguments)
    jitted(plan, structure).trace(*shapes)


@contextmanager
def computing_on(device: Any) -> Iterator[None]:
    """Compute in double precision on a device."""
    with jax.enable_x64(True), jax.default_device(device):
        yield


def compiling() -> bool:
    return bool(COMPILING)


def taken_apart(arguments: Arguments) -> tuple[list[np.ndarray], Any, tuple[Any, ...]]:
    leaves, structure = jax.tree.flatten(arguments)
    arrays = list(map(np.asarray, leaves))
    return arrays, structure, tuple(jax.ShapeDtypeStruct(a.shape, a.dtype) for a in arrays)


@functools.cache
def compiled(
    plan: Plan, structure: Any, shapes: ArrayShapes, device: Any
) -> Callable[..., Outcome]:
    COMPILING.add(threading.get_ident())
    try:
        described = description_of(plan, jax.tree.unflatten(structure, shapes))
        function = jitted(plan, structure)
        if described is None:
            return function.lower(*shapes).compile()
        return by_kept_trace(described, function, shapes)
    finally:
        COMPILING.discard(threading.get_ident())


def by_kept_trace(described: bytes, function: Any, shapes: ArrayShapes) -> Callable[..., Any]:
    """A jitted function compiled for arrays of these shapes; its trace is kept.

    The trace of a function that calls the host, as solvers of diffrax do, cannot be kept.
    """
    file = trace_file(described + repr(shapes).encode())
    exported = None if file is None else read_trace(file)
    if exported is None:
        calls = [export.DisabledSafetyCheck.custom_call("ALL")]
        try:
            exported = export.export(function, disabled_checks=calls)(*shapes)
        except NotImplementedError:
            return function.lower(*shapes).compile()
        if file is not None:
            write_trace(file, exported)
    return jax.jit(exported.call, compiler_options=options()).lower(*shapes).compile()


@functools.cache
def jitted(plan: Plan, structure: Any) -> Any:
    """The plan's engine as a function of arrays; JAX keeps its traces in this process."""

    def simulate(*leaves: jax.Array) -> Outcome:
        network, clock, queue, count = jax.tree.unflatten(structure, leaves)
        # One loop around everything, compiled as one function: 1.02 times, plain, 12 vehicles.
        # Without it, iteration over links ends in other bits.
        return xla.materialised(lambda: plan.engine.simulate(queue, count, network, clock, plan))

    return jax.jit(simulate, compiler_options=options())


def options() -> dict[str, str] | None:
    """Compiler options for the default device."""
    return COMPILER.get(platform())


def platform() -> str:
    return (jax.config.values["jax_default_device"] or jax.devices()[0]).platform


class ForeignError(Exception):
    """A program has code from outside the package."""


class Describer(pickle.Pickler):
    """Writes the same bytes for the same program in each process; raises ForeignError."""

    fast = True  # else identities of equal objects show

    def reducer_override(self, obj: Any) -> Any:
        named = obj if isinstance(obj, type) or hasattr(obj, "__qualname__") else type(obj)
        module = obj.module if isinstance(obj, Origin) else named.__module__
        if module.partition(".")[0] not in ("jaxnet", "jax", "numpy", "builtins"):
            raise ForeignError(module)
        return NotImplemented


def description_of(plan: Plan, arguments: Any) -> bytes | None:
    """What tells a program from others; None where it has code from outside."""
    described = io.BytesIO()
    shapes = jax.tree.map(lambda each: (each.shape, str(each.dtype)), arguments)
    try:
        Describer(described).dump((plan, shapes))
    except (ForeignError, pickle.PicklingError, AttributeError, TypeError):
        return None
    return described.getvalue()


def trace_file(described: bytes) -> Path | None:
    """The file of a trace; None without a local folder of compiled programs."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    if not folder or "://" in folder:
        return None
    settings = f"{platform()} {sorted(jax.config.values.items(), key=str)}"
    return Path(folder) / "traces" / sha(own_code() + settings.encode() + described).hex()


@functools.cache
def own_code() -> bytes:
    """Digest of the package's code, and of the versions of what it calls in tracing."""
    root = Path(__file__).parents[1]
    files = sorted(root.rglob("*.py"))
    every = b"".join(f"{each.relative_to(root)}\n".encode() + each.read_bytes() for each in files)
    versions = {name: metadata.version(name) for name in LIBRARIES}
    return sha(f"{versions}\n".encode() + every)


def read_trace(file: Path) -> export.Exported | None:
    """The trace in a file; None if there is none that is whole."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    checksum, trace = content[:32], content[32:]
    return export.deserialize(bytearray(trace)) if sha(trace) == checksum else None


def write_trace(file: Path, exported: export.Exported) -> None:
    """Write a trace for later processes, where the folder can be written."""
    trace = bytes(exported.serialize())
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
        part.write_bytes(sha(trace) + trace)
        part.replace(file)


def sha(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()
