"""Monte Carlo attack studies on networks of two-wheeled robots.

- `load` reads a study, `network` makes a topology of a matrix or a networkx graph.
- `run` simulates a study into a results folder, `run_part` a part of it, `simulate` in memory.
- `search` looks for the attacker's worst choice, `sensitivity` computes Sobol's indices, `rare`
  estimates a small probability of failure.
- `open` reads a results folder, `compare` compares two results folders.
- `Results` has tables and arrays, fits, replays, films, plots, the report and a file for MATLAB.
- `field` returns the vector field of one lane.
"""

import importlib
from typing import TYPE_CHECKING

from jaxnet.version import __version__ as __version__

if TYPE_CHECKING:
    from jaxnet.api.results import Part, Replay, Results, open
    from jaxnet.api.studies import (
        compare,
        field,
        rare,
        run,
        run_part,
        search,
        sensitivity,
        simulate,
    )
    from jaxnet.config.document import ConfigError
    from jaxnet.config.networks import network
    from jaxnet.config.study import Study, load
    from jaxnet.kinds.kind import KindError
    from jaxnet.runs.cluster import ClusterError
    from jaxnet.store.folder import FolderError

# The module of each public name, imported at its first use: the command line starts at once.
HOMES = {
    "ClusterError": "jaxnet.runs.cluster",
    "ConfigError": "jaxnet.config.document",
    "FolderError": "jaxnet.store.folder",
    "KindError": "jaxnet.kinds.kind",
    "Part": "jaxnet.api.results",
    "Replay": "jaxnet.api.results",
    "Results": "jaxnet.api.results",
    "Study": "jaxnet.config.study",
    "compare": "jaxnet.api.studies",
    "field": "jaxnet.api.studies",
    "load": "jaxnet.config.study",
    "network": "jaxnet.config.networks",
    "open": "jaxnet.api.results",
    "rare": "jaxnet.api.studies",
    "run": "jaxnet.api.studies",
    "run_part": "jaxnet.api.studies",
    "search": "jaxnet.api.studies",
    "sensitivity": "jaxnet.api.studies",
    "simulate": "jaxnet.api.studies",
}
__all__ = [
    "ClusterError",
    "ConfigError",
    "FolderError",
    "KindError",
    "Part",
    "Replay",
    "Results",
    "Study",
    "compare",
    "field",
    "load",
    "network",
    "open",
    "rare",
    "run",
    "run_part",
    "search",
    "sensitivity",
    "simulate",
]


def __getattr__(name: str) -> object:
    """Import a public name at its first use."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(HOMES[name]), name)


def __dir__() -> list[str]:
    """Return the names of the package, also those that are not imported yet."""
    return sorted({*globals(), *__all__})
