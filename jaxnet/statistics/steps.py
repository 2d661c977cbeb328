"""How long work says how far it is."""

from collections.abc import Callable

Steps = Callable[[str, int, int], None]  # what is done, how often it is, and how often it will be


def no_progress(what: str, done: int, total: int) -> None:
    """Tell nobody."""
