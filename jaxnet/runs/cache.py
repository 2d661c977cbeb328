"""XLA's persistent compilation cache, kept apart for every version and type of machine."""

import hashlib
import os
import platform
import sys
from importlib import metadata
from pathlib import Path

SHORTEST = 0.1  # [s], of compilations that are kept


def enable() -> None:
    """Turn the cache on, in this process and those it starts; JAX_COMPILATION_CACHE_DIR names another folder.

    JAX is not imported for it.
    """
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    machine = hashlib.sha256(f"{platform.machine()} {processor()}".encode()).hexdigest()[:12]
    folder = home / "jaxnet" / "xla" / f"{metadata.version('jaxlib')}-{machine}"
    wanted = {"JAX_COMPILATION_CACHE_DIR": folder, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": SHORTEST}
    for name, value in wanted.items():
        if not os.environ.get(name):
            os.environ[name] = str(value)
    if "jax" in sys.modules:  # which has read the environment already
        import jax

        jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
        jax.config.update("jax_persistent_cache_min_compile_time_secs", SHORTEST)


def processor() -> str:
    """What the processor calls itself and can do."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(line for line in lines if line.startswith(("model name", "flags")))
