"""Everything to be looked at of a results folder, what is missing for it made first."""

from collections.abc import Iterator

from upath import UPath

from jaxnet.study import ultimate
from jaxnet.study.api import Results
from jaxnet.study.replay import replay_worst
from jaxnet.view import figures, page


def write(results: Results) -> Iterator[UPath]:
    """Fit, simulate the worst lanes again, draw, and write the page; the files, one after the other."""
    _ = results.cells  # refuses an unfinished run
    if ultimate.asked(results) and not (results.path / "fit.csv").exists():
        yield from ultimate.analyse(results)
    yield from replay_worst(results)
    yield from figures.draw(results)
    yield page.write(results)
