"""XLA's flags, and its persistent cache of programs for each version and type of machine."""

import contextlib
import hashlib
import os
import platform
import sys
from importlib import metadata
from pathlib import Path

OF_JAX = 3.2e9  # bytes of addresses: 3.1e9 are too few on two cores, 3.4e9 enough
OF_CHECKS = 0.7e9  # the same without JAX: with 0.5e9 NumPy's libraries hang
SHORTEST_COMPILATION = 0.1  # [s], of compilations that are kept
# - Loops that move no more bytes than that are compiled as one function, not by operation.
# - LLVM takes choices out of loops, which then run in vectors: 1.4 times, 12 vehicles that trim.
# - Level 2 compiles 1.3 times as fast as level 3, and its programs are as fast.
FLAGS = (
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=100000000,-enable-nontrivial-unswitch=true"
    " --xla_backend_optimization_level=2"
)


def enable() -> None:
    """Turn the cache on in this process and its children, unless JAX has another cache.

    Another cache comes from JAX_COMPILATION_CACHE_DIR or from JAX's config. The function does not
    import JAX. Existing XLA_FLAGS stay. If JAX has compiled before, the flags come too late, and
    its programs are slower. Raises MemoryError where `ulimit -v` is so low that JAX would end the
    process without a word.
    """
    refuse_low_limit(OF_JAX)
    os.environ.setdefault("XLA_FLAGS", FLAGS)
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # slow compilation is logged as an error
    if "jax" in sys.modules and sys.modules["jax"].config.jax_compilation_cache_dir is not None:
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    processor = platform.processor()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = "\n".join(line for line in lines if line.startswith(("model name", "flags")))
    machine = hashlib.sha256(f"{platform.machine()} {processor}".encode()).hexdigest()[:12]
    folder = home / "jaxnet" / "xla" / f"{metadata.version('jaxlib')}-{machine}"
    wanted = {
        "JAX_COMPILATION_CACHE_DIR": folder,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": SHORTEST_COMPILATION,
    }
    for name, value in wanted.items():
        if not os.environ.get(name):
            os.environ[name] = str(value)
    if jax := sys.modules.get("jax"):  # which has read the environment already
        jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
        shortest = float(os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"])
        jax.config.update("jax_persistent_cache_min_compile_time_secs", shortest)


def refuse_low_limit(least: float) -> None:
    """Raise MemoryError if `ulimit -v` allows the process fewer bytes of addresses."""
    if sys.platform == "win32":
        return
    import resource

    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    if allowed != resource.RLIM_INFINITY and allowed < least:
        given, needed = f"{allowed / 1e9:.2g} GB of addresses", f"{least / 1e9:g} GB are needed"
        raise MemoryError(f"ulimit -v allows {given}, {needed}")
