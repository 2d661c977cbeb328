"""Monte Carlo attack studies on networks of vehicles.

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
    from jaxnet.api.results import Part as Part
    from jaxnet.api.results import Replay as Replay
    from jaxnet.api.results import Results as Results
    from jaxnet.api.results import open as open
    from jaxnet.api.studies import compare as compare
    from jaxnet.api.studies import field as field
    from jaxnet.api.studies import rare as rare
    from jaxnet.api.studies import run as run
    from jaxnet.api.studies import run_part as run_part
    from jaxnet.api.studies import search as search
    from jaxnet.api.studies import sensitivity as sensitivity
    from jaxnet.api.studies import simulate as simulate
    from jaxnet.config.document import ConfigError as ConfigError
    from jaxnet.config.networks import network as network
    from jaxnet.config.study import Study as Study
    from jaxnet.config.study import load as load
    from jaxnet.kinds.kind import KindError as KindError
    from jaxnet.runs.cluster import ClusterError as ClusterError
    from jaxnet.store.folder import FolderError as FolderError

# Public names by module, each imported at its first use: the command line starts at once.
PUBLIC = {
    "api.results": ("Part", "Replay", "Results", "open"),
    "api.studies": (
        *("compare", "field", "rare", "run", "run_part", "search", "sensitivity", "simulate"),
    ),
    "config.document": ("ConfigError",),
    "config.networks": ("network",),
    "config.study": ("Study", "load"),
    "kinds.kind": ("KindError",),
    "runs.cluster": ("ClusterError",),
    "store.folder": ("FolderError",),
}
HOMES = {name: f"jaxnet.{home}" for home, names in PUBLIC.items() for name in names}
__all__ = sorted(HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
