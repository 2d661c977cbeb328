"""Monte Carlo attack studies on networks of two-wheeled robots.

`load` reads a study from YAML, `run` simulates it into a results folder and `run_part` a part of it, `open`
reads such a folder.
"""

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from jaxnet.api import open, run, run_part
    from jaxnet.config.study import load

# Where each name is; imported when it is asked for, so that the command's help is there at once.
HOMES = {"load": "jaxnet.config.study", "open": "jaxnet.api", "run": "jaxnet.api", "run_part": "jaxnet.api"}
__all__ = ["load", "open", "run", "run_part"]


def __getattr__(name: str):
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(HOMES[name]), name)
