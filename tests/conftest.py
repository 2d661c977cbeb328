"""Tests run as strictly as can be: double precision, no silent promotion, shapes and types checked."""

import os

os.environ.setdefault("JAX_ENABLE_X64", "true")
os.environ.setdefault("JAX_NUMPY_DTYPE_PROMOTION", "strict")
os.environ.setdefault("JAX_NUMPY_RANK_PROMOTION", "raise")

from hypothesis import settings
from jaxtyping import install_import_hook

install_import_hook("jaxnet", "beartype.beartype")

settings.register_profile("jaxnet", deadline=None, max_examples=40, derandomize=True)
settings.load_profile("jaxnet")
