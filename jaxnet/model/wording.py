"""Wording of numbers, cells, kinds and things for text output."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from decimal import ROUND_HALF_UP, Decimal

Named = Callable[[Sequence[int]], str]  # names cells by their numbers
MOST_RUNS = 12  # of cells that are named
RESULT_DIGITS = 3  # significant ones of a result wherever a reader sees it; CSV files have all
NAME_DIGITS = 4  # of a swept value, which names a cell
HALF_A_DECIMAL = Decimal("0.05")
DECIMAL_POWERS = range(-4, 6)  # of the first digit of a number that is written without exponent


def number_text(value: float, digits: int = RESULT_DIGITS, whole: float = math.inf) -> str:
    """A number to so many significant digits, halves rounded up; no digit before the point is lost.

    A share of a `whole` has one decimal, as few lanes tell no more; it has another digit only where
    it would read 0 or the whole: 99.98 % of the lanes are not 100 %.
    """
    given = Decimal(f"{value + 0.0:.9g}")  # 36.5 where a float is 36.499999999999996; 0 for -0
    if not given.is_finite() or given.adjusted() not in DECIMAL_POWERS:
        return f"{value:.{digits}g}"
    last = given.adjusted() - digits + 1
    if whole < math.inf:
        least = min(abs(given), Decimal(whole) - abs(given))
        last = -1 if least > HALF_A_DECIMAL else least.adjusted()
    shown = given.quantize(Decimal(1).scaleb(min(last, 0)), ROUND_HALF_UP)
    return f"{shown.normalize():f}"


def ranges(numbers: Sequence[int]) -> str:
    """Numbers as text, with runs of three or more abbreviated: 1-3, 5."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    short = (f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)
    return ", ".join(short)


def cells_named(numbers: Sequence[int]) -> str:
    """The name of cells by their numbers: cell 0, cells 0-3, or of many 100 cells (2, 5, …)."""
    runs = ranges(numbers).split(", ")
    if len(runs) > MOST_RUNS:
        return f"{len(numbers)} cells ({', '.join(runs[:3])}, …)"
    return f"cell{'s' if len(numbers) > 1 else ''} {', '.join(runs)}"


def plural_s(who: str) -> str:
    """The ending of a verb: s if `who` is a single number, else nothing."""
    return "s" if who.isdigit() else ""


def counted(kinds: Counter[str]) -> str:
    """The number of things of each kind as text, the most frequent kind first."""
    return ", ".join(f"{many:,} {kind}" for kind, many in kinds.most_common())


def count(number: int, noun: str) -> str:
    """A number with its noun, in the plural unless the number is 1."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def orders_in_words(sizes: Sequence[float]) -> str:
    """One size for each order of derivatives with its unit: 15 m, 10 m/s, 5 m/s²."""
    units = ("m", "m/s", "m/s²", "m/s³", "m/s⁴")
    return ", ".join(f"{size:.4g} {unit}" for size, unit in zip(sizes, units, strict=False))


def sets_in_words(times: Sequence[float], sets: Sequence[Sequence[int]]) -> str:
    """Sets of numbers, each from a time on [s], in words: 1, 2 until 10 s, then nobody."""
    first = ["nobody"] if times[0] > 0 else []
    names = [*first, *(ranges(sorted(each)) or "nobody" for each in sets)]
    ends = zip(names, times[not first :], strict=False)
    until = [f"{name} until {time:g} s" for name, time in ends]
    return ", then ".join([*until, names[-1]])


def count_between(numbers: Collection[int], noun: str) -> str:
    """The least and the greatest number with their noun: 256 to 864 lanes."""
    least, most = min(numbers), max(numbers)
    return f"{f'{least:,} to ' if least < most else ''}{count(most, noun)}"
