"""Modules that Python imports at the first use of a name from them, so that a command starts at once.

A type checker reads the plain import under `TYPE_CHECKING`, which stands beside each stand-in.
"""

from importlib import import_module
from types import ModuleType
from typing import Any


class LazyModule(ModuleType):
    """A stand-in for a module: reading an attribute imports the module, if Python has not done so yet."""

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the module."""
        return getattr(import_module(self.__name__), name)
