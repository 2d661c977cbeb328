"""Number of CPU cores. This module imports no JAX, so callers can ask before JAX is imported."""

import os


def cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
