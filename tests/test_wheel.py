"""The wheel: what is installed runs away from the checkout, with all that is no Python."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STUDY = "{'engine': 'exact', 'horizon': 0.2, 'tail': 0.1, 'vehicles': 3, 'attack': 'none'}"
PROGRAM = f"""
import sys
import jaxnet
from pathlib import Path
from jaxnet.view.page import write_page
assert Path(jaxnet.__file__).is_relative_to(sys.argv[1]), jaxnet.__file__
results = jaxnet.run(jaxnet.load({STUDY}), "out", progress=False)
print(results.manifest["lanes"]["ok"], write_page(results))
"""


@pytest.mark.long
def test_a_wheel_runs_outside_the_checkout(tmp_path):
    """Built from the checkout, unpacked elsewhere: a study is run and its page written."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--wheel-dir", str(tmp_path), str(ROOT)], check=True, cwd=tmp_path)
    (wheel,) = tmp_path.glob("jaxnet_sim-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        packed.extractall(tmp_path / "installed")
    files = {
        path.relative_to(ROOT).as_posix() for path in (ROOT / "jaxnet").rglob("*") if path.is_file()
    }
    files = {name for name in files if "__pycache__" not in name}
    assert files == {name for name in names if name.startswith("jaxnet/")}
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    run = [sys.executable, "-P", "-c", PROGRAM, str(tmp_path / "installed")]
    told = subprocess.run(
        run, check=True, cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert told.stdout.split()[0] == "1"
    assert "report.html" in told.stdout
