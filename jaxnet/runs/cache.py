"""XLA's flags, and its persistent cache of programs, separate for each version and type of machine."""

import hashlib
import os
import platform
import sys
from importlib import metadata
from pathlib import Path

SHORTEST_COMPILATION = 0.1  # [s], of compilations that are kept
# - Loops that move no more bytes than that are compiled as one function, not operation by operation.
# - LLVM takes choices out of loops, which then run in vectors: 1.4 times, trimming, loss, 12 vehicles.
# - Level 2 compiles 1.3 times as fast as level 3, and its programs are as fast.
FLAGS = (
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=100000000,-enable-nontrivial-unswitch=true"
    " --xla_backend_optimization_level=2"
)


def enable() -> None:
    """Turn the cache on in this process and its children, unless JAX has another cache.

    Another cache comes from JAX_COMPILATION_CACHE_DIR or from JAX's config. The function does not import JAX.
    Existing XLA_FLAGS stay. If JAX has compiled before, the flags come too late, and its programs are slower.
    """
    os.environ.setdefault("XLA_FLAGS", FLAGS)
    if "jax" in sys.modules and sys.modules["jax"].config.jax_compilation_cache_dir is not None:
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    machine = hashlib.sha256(f"{platform.machine()} {processor()}".encode()).hexdigest()[:12]
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


def processor() -> str:
    """Return the name and the features of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(line for line in lines if line.startswith(("model name", "flags")))
