"""Modules that Python imports at the first use of a name from them: a command starts at once.

`jax` and `jnp` stand here for all rooms that are loaded without JAX, and `sparse`, `special` and
`stats` of SciPy. A type checker reads the plain import under `TYPE_CHECKING`, which stands beside
each stand-in.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any


class LazyModule(ModuleType):
    """A stand-in for a module, which is imported when an attribute is first read."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)


class LazyPackage(ModuleType):
    """A stand-in for a package, each of whose modules is imported at its first use."""

    def __getattr__(self, name: str) -> Any:
        return import_module(f"{self.__name__}.{name}")


if TYPE_CHECKING:
    import jax as jax
    import jax.numpy as jnp
    from scipy import sparse as sparse
    from scipy import special as special
    from scipy import stats as stats
else:
    jax, jnp = LazyModule("jax"), LazyModule("jax.numpy")
    sparse, special = LazyModule("scipy.sparse"), LazyModule("scipy.special")
    stats = LazyModule("scipy.stats")
