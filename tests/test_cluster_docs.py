"""The scripts of docs/cluster.md do what the page says."""

import itertools
import re
import runpy
import shlex
import signal
import subprocess
from pathlib import Path

import dask
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main

PAGE = (Path(__file__).parents[1] / "docs" / "cluster.md").read_text()
ARRAY, FINISH = re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL)
(DASK,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SMALL = {"name": "small", "vehicles": 3, "samples": 2, "horizon": 1.0, "tail": 0.5}
SMALL |= {"engine": "exact", "defence": "none", "attack": "none"}
SMALL |= {"sweep": {"initial.speed": [0.1, 0.2, 0.3, 0.4]}}


@pytest.fixture
def there(tmp_path, monkeypatch):
    """A folder with the study, and a `jaxnet` that says how it was called."""
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(SMALL))
    (tmp_path / "jaxnet").write_text("#!/bin/sh\nprintf '%s\\n' \"$@\"\n")
    (tmp_path / "jaxnet").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    return tmp_path


def submitted(script, there, **variables):
    """What a batch script calls jaxnet with, as SLURM would run it."""
    (cores,) = re.findall(r"^#SBATCH --cpus-per-task=(\d+)$", script, re.MULTILINE)
    slurm = {"SCRATCH": there / "a scratch", "SLURM_CPUS_PER_TASK": cores} | variables
    given = [f"{name}={value}" for name, value in slurm.items()]
    return subprocess.check_output(
        ["env", *given, "bash", "-eu", "-c", script], text=True
    ).splitlines()


@pytest.mark.long
def test_the_job_array_and_the_job_that_finishes_leave_the_rows_of_a_plain_run(there):
    """Also if one of its three tasks never ran; the tasks write rows alone."""
    commands = [
        submitted(ARRAY, there, SLURM_ARRAY_TASK_ID=task, SLURM_ARRAY_TASK_COUNT=3)
        for task in (0, 2)
    ]
    assert [words[-2:] for words in commands] == [["--shard", "0/3"], ["--shard", "2/3"]]
    finish = submitted(FINISH, there)
    assert all(finish == words[:-2] for words in commands)
    out = there / "a scratch" / "study"
    plain = there / "plain"
    for words in (*commands, finish, ["run", "study.yaml", "--out", str(plain)]):
        done = CliRunner().invoke(main, words)
        assert done.exit_code == 0, done.stderr
        if words is commands[-1]:
            written = {path.name for path in out.rglob("*.*") if path.is_file()} - {".lock"}
            assert written == {"00000.parquet", "00002.parquet", "00003.parquet"}
    ours, plain = jaxnet.open(out), jaxnet.open(plain)
    assert len(plain.lanes) == 8
    pd.testing.assert_frame_equal(ours.lanes, plain.lanes, check_exact=True)
    pd.testing.assert_frame_equal(ours.cells, plain.cells, check_exact=True)
    assert re.findall(r"^#SBATCH --array=(.*)$", ARRAY, re.MULTILINE) == ["0-15"]
    assert "--dependency=afterany:$array finish.sbatch" in PAGE


@pytest.mark.long
def test_dask_starts_the_workers_that_the_page_asks_for(there, monkeypatch):
    """The job script, and what is run on which scheduler."""
    before = signal.getsignal(signal.SIGINT)
    from dask_jobqueue import SLURMCluster

    signal.signal(signal.SIGINT, before)  # the import takes Ctrl-C over
    seen = {}

    def scale(cluster, n=0, jobs=0):  # closing it scales to nothing
        if jobs:
            seen.update(script=cluster.job_script(), address=cluster.scheduler_address, jobs=jobs)

    monkeypatch.setattr(SLURMCluster, "scale", scale)
    monkeypatch.setattr(
        jaxnet, "run", lambda study, out, cluster: seen.update(out=out, cluster=cluster)
    )
    (there / "script.py").write_text(DASK)
    runpy.run_path("script.py")
    assert not seen, "what imports the script must start nothing"
    address = {"jobqueue.slurm.scheduler-options": {"dashboard_address": "127.0.0.1:0"}}
    with dask.config.set(address):
        runpy.run_path("script.py", run_name="__main__")
    assert (seen["cluster"], seen["jobs"]) == (seen["address"], 8)
    assert Path(seen["out"]).is_absolute()
    lines = seen["script"].splitlines()
    assert {
        "#SBATCH --cpus-per-task=16",
        "#SBATCH --mem=15G",
        "#SBATCH -t 04:00:00",
        "export NPROC=8",
        "export JAX_COMPILATION_CACHE_DIR=${TMPDIR:-/tmp}/jaxnet-$USER",
    } <= set(lines)
    (start,) = (shlex.split(line) for line in lines if "distributed.cli.dask_worker" in line)
    options = dict(itertools.pairwise(start))
    assert start[3] == seen["address"]
    given = (options["--nworkers"], options["--nthreads"], options["--death-timeout"])
    assert given == ("2", "8", "600")
