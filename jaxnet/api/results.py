"""`Results`: tables, arrays, fits, replays, films, figures and the report of a results folder."""

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, SupportsInt

import pandas as pd
from upath import UPath

from jaxnet.lazy import LazyModule
from jaxnet.runs.cache import enable
from jaxnet.store import results as stored
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.manifest import MANIFEST
from jaxnet.store.results import Part, arrays_at, whole_number, written_into
from jaxnet.store.rows import refuse_lost

if TYPE_CHECKING:
    import xarray

    from jaxnet.statistics.choice import Where
    from jaxnet.view.figures.every import Plots
    from jaxnet.view.figures.style import Figure

exports = LazyModule("jaxnet.store.export")
figures = LazyModule("jaxnet.view.figures.every")
replays = LazyModule("jaxnet.runs.replay")
tables = LazyModule("jaxnet.view.text.tables")
writing = LazyModule("jaxnet.api.writing")

AnyPath = str | Path | UPath

__all__ = ["Part", "Replay", "Results", "open"]


class Replay(NamedTuple):
    """One lane that was simulated again.

    Attributes
    ----------
    row
        The lane's row, as in `Results.lanes`.
    trajectory
        States, attack signals, weights in force and errors over (lane, time, …), with one lane.
    path
        Path of the store that holds the trajectory.

    Examples
    --------
    >>> import jaxnet
    >>> results = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
    >>> results.replay(cell=0, sample=0)
    Replay(cell=0, sample=0, status='ok')
    """

    row: pd.Series
    trajectory: "xarray.Dataset"
    path: UPath

    def __repr__(self) -> str:
        cell, sample, status = (self.row[key] for key in ("cell", "sample", "status"))
        return f"Replay(cell={cell}, sample={sample}, status={status!r})"


@dataclasses.dataclass(frozen=True, repr=False)
class Results(stored.Results):
    """A results folder. Tables and arrays are read at their first use.

    Attributes
    ----------
    path
        Path of the results folder.
    out
        Folder for fits, figures, replays and the report; None is the results folder itself.
    trust
        Whether the code of kinds may be loaded from the places that the folder names.
    config
        The study's config or its folder; kinds are loaded from the modules beside it.
    found_all
        Whether `run` found all lanes in the folder and simulated none.

    Examples
    --------
    >>> import jaxnet
    >>> results = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
    >>> results.lanes[["cell", "sample", "status"]]
       cell  sample status
    0     0       0     ok
    1     0       1     ok
    """

    found_all: bool = dataclasses.field(default=False, compare=False)

    def fit(self, out: AnyPath | None = None) -> pd.DataFrame:
        """Fit the ultimate error against ā, compute the bounds of theory, and write both.

        Parameters
        ----------
        out
            Folder for the files; None is the results' own folder.

        Returns
        -------
        pd.DataFrame
            The fits, as `Results.fits` reads them from `fit.csv`.

        Raises
        ------
        FolderError
            The run is unfinished, the study neither fixes nor sweeps ā, or another process writes
            there.

        Examples
        --------
        >>> import jaxnet
        >>> keys = {"engine": "exact", "horizon": 5.0, "sweep": {"attack.magnitude": [1, 10]}}
        >>> fits = jaxnet.simulate(keys, samples=2).fit()
        >>> fits["model"].unique().tolist()
        ['proportional', 'affine', 'power', 'constant']
        """
        written = written_into(self, out)
        for _ in writing.write_fits(written):
            pass
        return written.fits

    def replay(
        self,
        cell: SupportsInt,
        sample: SupportsInt,
        engine: str | None = None,
        out: AnyPath | None = None,
    ) -> Replay:
        """Simulate one lane again and store its trajectory.

        Parameters
        ----------
        cell, sample
            Numbers of the cell and of the sample, from 0.
        engine
            Name of an engine; None is the study's own engine.
        out
            Folder for the trajectory's store; None is the results' own folder.

        Returns
        -------
        Replay
            The lane's row, its trajectory and the path of the trajectory's store.

        Raises
        ------
        FolderError
            The study has no such lane, or the engine cannot simulate it.

        Examples
        --------
        >>> import jaxnet
        >>> results = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
        >>> dict(results.replay(cell=0, sample=0).trajectory["states"].sizes)
        {'lane': 1, 'time': 51, 'vehicle': 12, 'state': 6}
        """
        enable()
        numbers = whole_number("cell", cell), whole_number("sample", sample)
        path, row = replays.replay(written_into(self, out), *numbers, engine)
        return Replay(row, arrays_at(path), path)

    def report(self, out: AnyPath | None = None, replay: bool = True) -> UPath:
        """Write the figures and `report.html`, a page that works offline.

        The method first makes missing fits. It also simulates the lanes again that the page shows:
        the median and the worst lane of up to twelve cells, and the worst lanes of a study that has
        `recovery`.

        Parameters
        ----------
        out
            Folder for the page and all that it is made of, also for results in memory; None is the
            results' own folder.
        replay
            Whether to simulate lanes again; if not, the page shows stored trajectories alone.

        Returns
        -------
        UPath
            Path of the page.

        Raises
        ------
        FolderError
            The run is unfinished, another process writes there, or `out` holds files that were made
            of other rows.

        Examples
        --------
        >>> import jaxnet, tempfile
        >>> keys = {"engine": "exact", "horizon": 5.0, "attack": "none"}
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     jaxnet.simulate(keys, samples=2).report(folder).name
        'report.html'
        """
        *_, page = writing.write_report(written_into(self, out), replayed=replay)
        return page

    def animate(self, cell: SupportsInt, sample: SupportsInt, out: AnyPath | None = None) -> UPath:
        """Write a film of one lane. A lane without a stored trajectory is simulated again.

        Parameters
        ----------
        cell, sample
            Numbers of the cell and of the sample, from 0.
        out
            File name that ends in .mp4 or .gif, or a folder; None is a file in `figures/`.

        Returns
        -------
        UPath
            Path of the film.

        Raises
        ------
        FolderError
            The study has no such lane, or the film is an .mp4 and ffmpeg is not installed.

        Examples
        --------
        >>> import jaxnet, tempfile
        >>> results = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     results.animate(cell=0, sample=0, out=f"{folder}/lane.gif").name
        'lane.gif'
        """
        numbers = whole_number("cell", cell), whole_number("sample", sample)
        return writing.write_film(self, *numbers, out)

    def export(self, out: AnyPath | None = None, form: str = "mat") -> UPath:
        """Write a file for MATLAB and Octave, or the trajectories as CSV for pandas, R and Excel.

        Parameters
        ----------
        out
            File name that ends in .mat, None for `results.mat` in the folder; or the folder of the
            CSV files, None for `csv` in the folder.
        form
            "mat", or "csv": a file for each stored lane, with a row for each time and vehicle.

        Returns
        -------
        UPath
            Path of the file, or of the folder of the CSV files.

        Raises
        ------
        FolderError
            A variable of MATLAB's file would exceed 2 GB, no trajectories are stored for CSV, or
            `form` is another.

        Examples
        --------
        >>> import jaxnet, tempfile
        >>> results = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     results.export(f"{folder}/study.mat").name
        'study.mat'
        """
        if form not in ("mat", "csv"):
            raise FolderError(f"form: one of mat, csv (got {form!r})")
        return exports.write_mat(self, out) if form == "mat" else exports.write_csv(self, out)

    def figure(
        self,
        name: str,
        where: "Where | None" = None,
        *,
        x: str | None = None,
        y: str | None = None,
        hue: str | None = None,
        panel: str | Iterable[str] | None = None,
        column: str = "two",
        size: str | tuple[float, float] | None = None,
        font_size: float | None = None,
        font: str | None = None,
        plain: bool = False,
        note: bool = True,
    ) -> "Figure":
        """Draw a figure, as `jaxnet figure` does.

        Parameters
        ----------
        name, where
            Name of the figure, and the value or values of swept keys that select cells.
        x, y, hue, panel
            Axes of `curve`; `bands` takes `y` and `hue`, heat maps take all but `y`.
        column, size
            Width in columns of a journal, "one" or "two", or a pair [in] or text like "86x64mm".
        font_size, font
            Size of the type [pt] and the family of an installed font.
        plain, note
            Whether the figure has matplotlib's own style, and whether a note stands at the top.

        Returns
        -------
        Figure
            A matplotlib figure, which a notebook shows; `savefig` writes it.

        Raises
        ------
        FolderError
            The folder lacks the figure's data, or an argument is unknown.

        Examples
        --------
        >>> import jaxnet
        >>> keys = {"engine": "exact", "horizon": 5.0, "sweep": {"attack.magnitude": [1, 10]}}
        >>> results = jaxnet.simulate(keys, samples=2)
        >>> results.figure("curve", y="tail_max", size=(3.5, 2.5)).get_size_inches().tolist()
        [3.5, 2.5]
        """
        axes = {"x": x, "y": y, "hue": hue, "panel": panel}
        look = {"column": column, "size": size, "font_size": font_size, "font": font, "note": note}
        return figures.draw_figure(self, name, where, plain, **axes, **look)

    def latex(
        self,
        columns: Sequence[str] = (),
        where: "Where | None" = None,
        sort: str | None = None,
        pivot: str | None = None,
    ) -> str:
        r"""Return the summary as a LaTeX table, as `jaxnet show --format latex` prints it.

        Parameters
        ----------
        columns, where
            Names of columns of `cells.csv`, and values of swept keys that select cells.
        sort, pivot
            Column to sort by ("-COLUMN": the greatest first), and the key that stands across.

        Returns
        -------
        str
            A `tabular` of the package booktabs.

        Raises
        ------
        FolderError
            The run is unfinished, or a column or key is unknown.

        Examples
        --------
        >>> import jaxnet
        >>> results = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
        >>> results.latex(["tail_mean_median"]).splitlines()[-1]
        '\\end{tabular}'
        """
        return tables.formatted(self, "latex", columns, where, sort, pivot)

    @property
    def plot(self) -> "Plots":
        """Figures, one method each, as in `results.plot.tails()`."""
        return figures.Plots(self)

    def _repr_html_(self) -> str:
        return tables.summary_html(self)


def open(
    path: AnyPath, out: AnyPath | None = None, trust: bool = False, config: AnyPath | None = None
) -> Results:
    """Open a results folder, which runs no code that the folder names.

    Replays, films, bounds and certificates need the code of kinds from outside: give `config` or
    `trust`. Tables, arrays and most figures do without.

    Parameters
    ----------
    path
        Path or URL of a results folder.
    out
        Folder for fits, figures, replays and the report; None is the results folder itself.
    trust
        Whether modules are loaded from the places that the folder names.
    config
        The study's config or its folder; modules beside it are loaded.

    Returns
    -------
    Results
        Tables, arrays and all that is made of them.

    Raises
    ------
    FolderError
        `path` is not a results folder, or `out` holds files that were made of other rows.

    Examples
    --------
    >>> import jaxnet
    >>> ran = jaxnet.simulate({"engine": "exact", "horizon": 5.0}, samples=2)
    >>> len(jaxnet.open(ran.path).lanes)
    2
    """
    beside = None if config is None else Path(str(config))
    if beside is not None and not beside.exists():
        raise FolderError(f"{beside}: there is no such config")
    folder = Folder(path)
    folder.refuse_strange()
    manifest, rows_there = folder.manifest, any(folder.path.glob("lanes/*.parquet"))
    if not manifest and not rows_there:
        config = f"it is a config, and jaxnet run {path} makes its results"
        why = config if folder.path.is_file() else "it has no manifest.json"
        raise FolderError(f"{path} is not a results folder: {why}")
    if manifest and (lacking := MANIFEST - {*manifest}):
        raise FolderError(f"{path}/manifest.json: not a manifest of ours: it has no {min(lacking)}")
    if manifest.get("finished"):
        refuse_lost(folder, manifest)
    found = Results(folder.path, None, trust, beside)
    if not manifest or not (rows_there or found.analyses):
        told = "holds an unfinished run: the same command without --shard finishes it"
        raise FolderError(f"{path} {told}")
    return written_into(found, out)
