"""What tests of kinds share."""

import jax
import pytest


@pytest.fixture
def compiled():
    """Programs that were compiled since."""
    names = []

    def listen(name, *_, **__):
        if "backend_compile" in name:
            names.append(name)

    jax.monitoring.register_event_duration_secs_listener(listen)
    return names
