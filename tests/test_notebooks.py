"""The notebooks in docs/notebooks/ run from the first cell to the last, and show what they store.

`jupyter nbconvert --to notebook --execute --inplace docs/notebooks/*.ipynb` stores fresh outputs;
nbconvert comes with the extra `docs`.
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
ROUNDED = 2e-3  # numbers are shown with three decimals; tests compile otherwise than users
OPTIMISED = "worst_case"  # simulates 20,000 lanes, which is worth compiling better
STARTUP = """
from jaxnet.statistics import fits
fits.RESAMPLES = 2  # the intervals are tested elsewhere
"""

pytestmark = [
    pytest.mark.long,
    pytest.mark.parametrize("stored", NOTEBOOKS, ids=lambda path: path.stem),
]


@pytest.fixture
def as_a_user_has_it(stored, tmp_path, monkeypatch):
    """Give kernels this checkout, folders of their own, and JAX's own settings."""
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


def shown(cell):
    """The words of a cell's outputs, and their numbers; columns are as wide as their numbers."""
    outputs = cell.get("outputs", [])
    texts = [each["text"] if "text" in each else each["data"]["text/plain"] for each in outputs]
    words = [re.sub(rf"{NUMBER.pattern}|\s", "", text) for text in texts]
    return words, [float(number) for text in texts for number in NUMBER.findall(text)]


def test_a_notebook_runs_and_shows_what_it_stores(stored, as_a_user_has_it):
    """No cell raises or warns; words are the stored ones, and numbers to rounding."""
    notebook = nbformat.read(stored, as_version=4)
    fresh = nbformat.read(stored, as_version=4)
    where = {"metadata": {"path": str(as_a_user_has_it)}}
    nbclient.NotebookClient(fresh, timeout=300, resources=where).execute()
    for before, now in zip(notebook.cells, fresh.cells, strict=True):
        words, numbers = shown(now)
        assert words == shown(before)[0], now.source
        assert numbers == pytest.approx(shown(before)[1], abs=ROUNDED, rel=ROUNDED), now.source


def test_a_notebook_is_stored_with_its_outputs(stored):
    """Cells ran in order, a title first, without warnings, and figures have few bytes."""
    cells = nbformat.read(stored, as_version=4).cells
    code = [cell for cell in cells if cell.cell_type == "code"]
    assert cells[0].source.startswith("# ")
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not any(output.get("name") == "stderr" for cell in code for output in cell.outputs)
    assert stored.stat().st_size < 300_000
