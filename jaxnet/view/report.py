"""Everything to be looked at of a results folder, what is missing for it made first."""

from collections.abc import Iterator

from upath import UPath

from jaxnet.runs.replay import replay_worst
from jaxnet.statistics import ultimate
from jaxnet.store.results import Results
from jaxnet.view import page
from jaxnet.view.figures import every as figures


def write(results: Results) -> Iterator[UPath]:
    """Fit, simulate the worst lanes again, draw, and write the page; the files, one after the other."""
    _ = results.cells  # refuses an unfinished run
    if ultimate.asked(results) and not (results.path / "fit.csv").exists():
        yield from ultimate.analyse(results)
    yield from replay_worst(results)
    yield from figures.draw(results)
    yield page.write(results)
