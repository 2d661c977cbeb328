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
SMALL = {
    "name": "small",
    "vehicles": 3,
    "samples": 2,
    "horizon": 1.0,
    "tail": 0.5,
    "engine": "exact",
    "defence": "none",
    "attack": "none",
    "sweep": {"initial.speed": [0.1, 0.2, 0.3, 0.4]},
}


@pytest.fixture
def slurm():
    """dask-jobqueue's cluster, whose import takes Ctrl-C over."""
    before = signal.getsignal(signal.SIGINT)
    from dask_jobqueue import SLURMCluster

    signal.signal(signal.SIGINT, before)
    return SLURMCluster


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
    cores = re.search(r"^#SBATCH --cpus-per-task=(\d+)$", script, re.MULTILINE)
    assert cores
    slurm = {"SCRATCH": there / "a scratch", "SLURM_CPUS_PER_TASK": cores[1]} | variables
    given = [f"{name}={value}" for name, value in slurm.items()]
    words = subprocess.check_output(["env", *given, "bash", "-eu", "-c", script], text=True)
    return words.splitlines()


def jaxnet_does(words):
    """One command, in this process."""
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.stderr
    return done


@pytest.mark.long
def test_the_job_array_and_the_job_that_finishes_leave_the_rows_of_a_plain_run(there):
    """Also if one of its three tasks never ran; the tasks write rows alone."""
    for task in (0, 2):
        words = submitted(ARRAY, there, SLURM_ARRAY_TASK_ID=task, SLURM_ARRAY_TASK_COUNT=3)
        assert words[-2:] == ["--shard", f"{task}/3"]
        jaxnet_does(words)
    out = there / "a scratch" / "study"
    names = {path.name for path in out.rglob("*.*") if path.is_file() and path.name != ".lock"}
    assert names == {"00000.parquet", "00002.parquet", "00003.parquet"}

    finish = submitted(FINISH, there)
    assert finish == words[:-2]
    jaxnet_does(finish)
    jaxnet_does(["run", "study.yaml", "--out", "plain"])
    ours, plain = jaxnet.open(out), jaxnet.open(there / "plain")
    assert len(plain.lanes) == 8
    pd.testing.assert_frame_equal(ours.lanes, plain.lanes, check_exact=True)
    pd.testing.assert_frame_equal(ours.cells, plain.cells, check_exact=True)


def test_the_array_counts_from_0_without_gaps_and_is_waited_for_whatever_became_of_it():
    """For i/n asks for i from 0 to n - 1."""
    assert re.findall(r"^#SBATCH --array=(.*)$", ARRAY, re.MULTILINE) == ["0-15"]
    assert "--dependency=afterany:$array finish.sbatch" in PAGE


@pytest.mark.long
def test_dask_starts_the_workers_that_the_page_asks_for(there, slurm, monkeypatch):
    """The job script, and what is run on which scheduler."""
    seen = {}

    def scale(cluster, n=0, jobs=0):  # closing it scales to nothing
        if jobs:
            seen.update(script=cluster.job_script(), address=cluster.scheduler_address, jobs=jobs)

    monkeypatch.setattr(slurm, "scale", scale)
    monkeypatch.setattr(
        jaxnet, "run", lambda study, out, cluster: seen.update(out=out, cluster=cluster)
    )
    (there / "script.py").write_text(DASK)
    runpy.run_path("script.py")
    assert not seen, "what imports the script must start nothing"
    with dask.config.set(
        {"jobqueue.slurm.scheduler-options": {"dashboard_address": "127.0.0.1:0"}}
    ):
        runpy.run_path("script.py", run_name="__main__")

    assert seen["cluster"] == seen["address"]
    assert seen["jobs"] == 8
    assert Path(seen["out"]).is_absolute()
    lines = seen["script"].splitlines()
    assert {"#SBATCH --cpus-per-task=16", "#SBATCH --mem=15G", "#SBATCH -t 04:00:00"} <= set(lines)
    assert "export NPROC=8" in lines
    assert "export JAX_COMPILATION_CACHE_DIR=${TMPDIR:-/tmp}/jaxnet-$USER" in lines
    (start,) = (shlex.split(line) for line in lines if "distributed.cli.dask_worker" in line)
    options = dict(itertools.pairwise(start))
    assert start[3] == seen["address"]
    assert (options["--nworkers"], options["--nthreads"]) == ("2", "8")
    assert options["--death-timeout"] == "600"
