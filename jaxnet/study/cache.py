"""XLA's persistent compilation cache, kept apart for every version and type of machine."""

import hashlib
import os
import platform
from importlib import metadata
from pathlib import Path

import jax


def enable() -> None:
    """Turn the cache on; JAX_COMPILATION_CACHE_DIR names another folder."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    machine = hashlib.sha256(f"{platform.machine()} {processor()}".encode()).hexdigest()[:12]
    folder = home / "jaxnet" / "xla" / f"{metadata.version('jaxlib')}-{machine}"
    jax.config.update("jax_compilation_cache_dir", os.environ.get("JAX_COMPILATION_CACHE_DIR") or str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def processor() -> str:
    """What the processor calls itself and can do."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(line for line in lines if line.startswith(("model name", "flags")))
