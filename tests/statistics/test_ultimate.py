"""From lanes to fits, bounds, violations and the page, by the commands that a user types."""

import re

import pandas as pd
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.statistics import fits as fit
from jaxnet.statistics.steps import no_progress
from jaxnet.store.folder import FolderError
from jaxnet.view.figures import every
from tests import systems

KEYS = {
    "engine": "exact",
    "horizon": 40.0,
    "tail": 1.0,
    "output_step": 0.5,
    "defence": "none",
    "sweep": {"topology": ["star", "cyclic"], "attack": ["bias"], "attack.magnitude": [0, 1, 10]},
    "recovery": {"tau": 0.01, "worst": 1},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A finished run of a constant attack in phase."""
    path = tmp_path_factory.mktemp("ultimate") / "out"
    jaxnet.run(systems.study(samples=8, **KEYS), path)
    return path


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    """The intervals are tested elsewhere."""
    monkeypatch.setattr(fit, "RESAMPLES", 2)


def invoke(*words):
    """What a command prints; it must end well."""
    done = CliRunner().invoke(main, [*map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_the_constant_attack_costs_what_is_known_exactly(folder):
    """Slopes 1 and 3.1034 of the greatest error are the static bound; nobody exceeds any."""
    text = invoke("fit", folder)
    assert "no lane with a bound is above it" in text
    results = jaxnet.open(folder)
    fits, bounds = results.fits, results.bounds
    assert list(fits) == ["topology", "attack", *fit.FIT_COLUMNS]
    assert list(bounds) == ["topology", "attack", "bound", "vehicle", "slope"]
    assert results.violations.empty
    straight = fits[(fits["model"] == "proportional") & (fits["metric"] == "tail_max")]
    for topology, exact in {"star": 1.0, "cyclic": 3.1034}.items():
        mine = straight[straight["topology"] == topology]
        assert mine["estimate"].tolist() == pytest.approx([exact] * 4, abs=1e-3)
        worst = bounds.query("topology == @topology and bound == 'static' and vehicle == 'worst'")
        assert worst["slope"].tolist() == pytest.approx([exact], abs=1e-4)
    envelope = fits[fits["quantile"] == 1.0]
    assert envelope[["low", "high"]].isna().all(axis=None)


@pytest.mark.long
def test_the_report_makes_what_is_missing(folder, monkeypatch):
    """The worst lane by the nonlinear engine; figures; a page that names the study."""
    drawn = every.draw_figures  # the other figures are alike, and tests/test_api.py has them drawn
    names = ("ultimate", "curve")
    monkeypatch.setattr(
        every, "draw_figures", lambda results, told=no_progress: drawn(results, names, told)
    )
    written = invoke("report", folder)
    assert len(list((folder / "replays").glob("*-nonlinear.zarr"))) == 1
    for name in ("report.html", "figures/ultimate.png", "figures/curve.png"):
        assert str(folder / name) in written
        assert (folder / name).stat().st_size > 1000


def test_a_violation_is_named_with_its_command(folder, undrawn):
    """A row that says that a lane was farther off than it may be."""
    shard = folder / "lanes" / "00001.parquet"
    whole = shard.read_bytes()
    rows = pd.read_parquet(shard)
    rows.loc[3, "tail_max"] = 1.01
    rows.to_parquet(shard)
    text = invoke("fit", folder)
    shard.write_bytes(whole)
    title = "ABOVE ITS BOUND: cell 1: star, bias, ā = 1 m, sample 3:\n  greatest error 1.01 m"
    assert title in text.replace("\xa0", " ")
    assert f"jaxnet replay {folder} --cell 1 --sample 3" in text
    assert jaxnet.open(folder).violations["bound"].tolist() == ["static"]


def test_what_was_derived_from_rows_goes_when_rows_are_added(folder):
    """Fits of eight samples do not stay beside the rows of nine."""
    invoke("fit", folder)
    jaxnet.run(systems.study(samples=8, **KEYS), folder)
    assert (folder / "fit.csv").exists()
    with pytest.warns(
        UserWarning, match="removing what was made of the rows before: fit.csv, bounds.csv"
    ):
        jaxnet.run(systems.study(samples=9, **KEYS), folder)
    assert not [
        name for name in ("fit.csv", "bounds.csv", "violations.csv") if (folder / name).exists()
    ]
    assert not (folder / "figures").exists()
    with pytest.raises(FolderError, match=r"has no fit.csv: jaxnet fit .* makes it"):
        _ = jaxnet.open(folder).fits


def test_a_study_without_an_attack_has_no_fit(tmp_path, undrawn):
    """It says so, and its report does without."""
    study = systems.study(samples=2, **KEYS | {"sweep": {}, "attack": "none"})
    jaxnet.run(study, tmp_path / "out")
    refused = CliRunner().invoke(main, ["fit", str(tmp_path / "out")])
    assert refused.exit_code == 2
    assert "no cell has an attack with ā > 0" in refused.output
    assert "report.html" in invoke("report", tmp_path / "out", "--no-replay")


def test_magnitudes_that_no_axis_has_room_for_are_said(tmp_path, undrawn):
    """From 1e-300 to 1e300 m: curves, a page, a sentence in place of δ̂(ā); tails are drawn."""
    keys = {"vehicles": 4, "horizon": 3.0, "attack": {"kind": "rotating", "vehicles": [2]}}
    sweep = {"attack.magnitude": [1e-300, 1e300]}
    study = systems.study(**KEYS | keys | {"sweep": sweep, "recovery": None, "samples": 2})
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    words = "ā is 1e-300 to 1e+300 m: an axis has room for 1e-100 to 1e+100 m"
    assert words in " ".join(invoke("fit", results.path).split())
    with pytest.raises(FolderError, match=re.escape(words)):
        every.Plots(results).ultimate()
    assert "report.html" in invoke("report", results.path, "--no-replay")
    assert "δ̂(ā) is not drawn" in (results.path / "report.html").read_text()
