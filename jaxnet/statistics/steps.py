"""Callback by which long computations report progress."""

from collections.abc import Callable

Steps = Callable[[str, int, int], None]  # arguments: activity, units done, units in total


def no_progress(what: str, done: int, total: int) -> None:
    """Ignore the report of progress."""
