"""Monte Carlo attack studies on networks of two-wheeled robots.

`load` reads a study from YAML, `run` simulates it into a results folder and `run_part` a part of it, `open`
reads such a folder.
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"
__all__ = ["load", "open", "run", "run_part"]

if TYPE_CHECKING:
    from jaxnet.study.api import load, open, run, run_part


def __getattr__(name: str):
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from jaxnet.study import api

    return getattr(api, name)
