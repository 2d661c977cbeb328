"""Modules that Python imports at the first use of a name from them: a command starts at once."""

from importlib import import_module
from types import ModuleType
from typing import Any


class LazyModule(ModuleType):
    """A stand-in for a module: reading an attribute imports the module."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)
