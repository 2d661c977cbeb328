"""Monte Carlo attack studies on networks of two-wheeled robots.

`load` reads a study, `run` simulates it into a results folder, `run_part` a part of it, `simulate` in memory;
`search` looks for the worst choice, `sensitivity` tells what matters, `rare` how rarely a defence fails;
`open` reads a results folder, `compare` holds two against each other. `Results` has tables and arrays, fits,
replays, films, plots, the report and a file for MATLAB. `field` gives the vector field of one lane.
"""

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from jaxnet.api import (
        Part,
        Replay,
        Results,
        compare,
        field,
        open,
        rare,
        run,
        run_part,
        search,
        sensitivity,
        simulate,
    )
    from jaxnet.config.document import ConfigError
    from jaxnet.config.study import Study, load
    from jaxnet.kinds.kind import KindError
    from jaxnet.runs.cluster import ClusterError
    from jaxnet.store.folder import FolderError

# Where each name is; imported when it is asked for, so that the command's help is there at once.
HOMES = {
    "ClusterError": "jaxnet.runs.cluster",
    "ConfigError": "jaxnet.config.document",
    "FolderError": "jaxnet.store.folder",
    "KindError": "jaxnet.kinds.kind",
    "Part": "jaxnet.api",
    "Replay": "jaxnet.api",
    "Results": "jaxnet.api",
    "Study": "jaxnet.config.study",
    "compare": "jaxnet.api",
    "field": "jaxnet.api",
    "load": "jaxnet.config.study",
    "open": "jaxnet.api",
    "rare": "jaxnet.api",
    "run": "jaxnet.api",
    "run_part": "jaxnet.api",
    "search": "jaxnet.api",
    "sensitivity": "jaxnet.api",
    "simulate": "jaxnet.api",
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
    "open",
    "rare",
    "run",
    "run_part",
    "search",
    "sensitivity",
    "simulate",
]


def __getattr__(name: str):
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
