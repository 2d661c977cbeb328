"""The notebooks in docs/notebooks/ run from the first cell to the last, and show what they store.

`jupyter nbconvert --to notebook --execute --inplace docs/notebooks/*.ipynb` stores fresh outputs; nbconvert
comes with the extra `docs`.
"""

import os
import re
from pathlib import Path

import nbclient
import nbformat
import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
ROUNDED = 2e-3  # numbers are shown with three decimals, and the tests compile otherwise than users
MOST_BYTES = 300_000
OPTIMISED = (
    "worst_case"  # simulates 20,000 lanes: less time to compile a little better than to wait for
)
STARTUP = """
from jaxnet.statistics import fits
fits.RESAMPLES = 2  # the intervals are tested elsewhere
"""


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def stored(request):
    """Return the path of a notebook."""
    return request.param


@pytest.fixture
def as_a_user_has_it(stored, tmp_path, monkeypatch):
    """Give kernels this checkout, folders of their own, and JAX's own settings in place of the tests'."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    if stored.stem == OPTIMISED:
        level = "xla_backend_optimization_level="
        monkeypatch.setenv("XLA_FLAGS", os.environ["XLA_FLAGS"].replace(f"{level}0", f"{level}1"))
    startup = tmp_path / "ipython" / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / "few_resamples.py").write_text(STARTUP)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    for strict in ("JAX_ENABLE_X64", "JAX_NUMPY_DTYPE_PROMOTION", "JAX_NUMPY_RANK_PROMOTION"):
        monkeypatch.delenv(strict)
    return tmp_path


def texts(cell):
    """Return the text of a cell's outputs, one for each output."""
    outputs = cell.get("outputs", [])
    return [
        output["text"] if "text" in output else output["data"]["text/plain"] for output in outputs
    ]


def numbers(text):
    """Return the numbers in a text."""
    return [float(number) for number in NUMBER.findall(text)]


def words(text):
    """Return a text without its numbers and spaces; columns are as wide as their numbers."""
    return re.sub(rf"{NUMBER.pattern}|\s", "", text)


def test_a_notebook_runs_and_shows_what_it_stores(stored, as_a_user_has_it):
    """No cell raises or warns; words are the stored ones, and numbers to rounding."""
    notebook = nbformat.read(stored, as_version=4)
    fresh = nbformat.read(stored, as_version=4)
    where = {"metadata": {"path": str(as_a_user_has_it)}}
    nbclient.NotebookClient(fresh, timeout=300, resources=where).execute()
    for cell, again in zip(notebook.cells, fresh.cells, strict=True):
        before, now = texts(cell), texts(again)
        assert list(map(words, now)) == list(map(words, before)), cell.source
        for shown, text in zip(now, before, strict=True):
            assert numbers(shown) == pytest.approx(numbers(text), abs=ROUNDED, rel=ROUNDED), (
                cell.source
            )


def test_a_notebook_is_short_and_stored_with_its_outputs(stored):
    """8 to 15 cells that ran in order, a title first, and figures of few bytes."""
    cells = nbformat.read(stored, as_version=4).cells
    code = [cell for cell in cells if cell.cell_type == "code"]
    assert 8 <= len(cells) <= 15
    assert cells[0].source.startswith("# ")
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    kinds = {kind for cell in code for output in cell.outputs for kind in output.get("data", {})}
    assert {"image/png", "text/html"} <= kinds
    assert not any(output.get("name") == "stderr" for cell in code for output in cell.outputs)
    assert stored.stat().st_size < MOST_BYTES


def test_numbers_of_an_output_are_compared_as_numbers():
    """A number that rounds differently is no other word; the words of a table do not depend on its width."""
    assert numbers("a 0.5\nb -1e-3") == [0.5, -1e-3]
    assert words("a   0.5\nb -1e-3 ") == words("a 0.25\nb 7") == "ab"
    assert words("status ok") != words("status failed")
