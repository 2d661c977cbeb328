"""Numbers of vehicles and things in words."""

from collections import Counter
from collections.abc import Sequence


def ranges(numbers: Sequence[int]) -> str:
    """Numbers with runs drawn together: 1-3, 5."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def cells_named(numbers: Sequence[int]) -> str:
    """Cells by their numbers: cell 0, cells 0-3."""
    return f"cell{'s' if len(numbers) > 1 else ''} {ranges(numbers)}"


def plural_s(who: str) -> str:
    """The verb's ending for one or several."""
    return "s" if who.isdigit() else ""


def counted(kinds: Counter[str]) -> str:
    """How many there are of each kind, the most first."""
    return ", ".join(f"{many:,} {kind}" for kind, many in kinds.most_common())


def count(number: int, noun: str) -> str:
    """A number of things."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
