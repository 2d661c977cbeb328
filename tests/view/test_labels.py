"""Labels are anybody's text: they leave as text in LaTeX, figures, CSV files and terminals."""

import io
import re

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from upath import UPath

import jaxnet
from jaxnet.cli import main
from jaxnet.config.document import CONTROLS
from jaxnet.config.naming import value_name, values_named
from jaxnet.store.folder import Folder
from jaxnet.store.tables import csv_text, read_table
from jaxnet.view.columns import summary_columns
from jaxnet.view.text import formats

FORMULA, ESCAPES = "=cmd|' /C calc'!A0", "\x1b[31mred\x1b]0;title\x07\nsecond\u202eline"
SHOWN = r"\x1b[31mred\x1b]0;title\x07\nsecond\u202eline"
NAME = "share_a of 5 % $\\bar{a$ \\input{x}\x1b"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A study whose labels are those of a stranger."""
    study = {
        "name": "labels",
        "samples": 2,
        "horizon": 0.5,
        "tail": 0.2,
        "vehicles": 3,
        "engine": "exact",
        "attack": {"kind": "rotating", "vehicles": [2]},
        "recovery": {"tau": 0.25},
        "labels": {"attack.magnitude": NAME},
        "sweep": {
            "attack.magnitude": [1, 10],
            "defence": [
                {"kind": "none", "label": FORMULA},
                {"kind": "none", "label": ESCAPES},
            ],
        },
    }
    return jaxnet.run(study, tmp_path_factory.mktemp("labels") / "out", progress=False)


def test_a_label_without_a_letter_is_told_with_its_key():
    assert value_name("channel.loss", "20 %").replace("\xa0", " ") == "lost messages = 20 %"
    assert value_name("channel.loss", "bursts") == "bursts"
    some = values_named("channel.loss", ["none", "20 %"], "and").replace("\xa0", " ")
    assert some == "no lost messages and lost messages = 20 %"
    some = values_named("channel.loss", ["10 %", "20 %"], "or").replace("\xa0", " ")
    assert some == "lost messages = 10 % or 20 %"


def test_latex_typesets_labels_as_they_are(results):
    """Every special character is escaped, in titles as in values, and no comment ends early."""
    text = formats.in_format(summary_columns(results), "latex", ["one\ntwo"])
    assert (
        r"share\_a of 5 \% \$\textbackslash{}bar\{a\$ "
        r"\textbackslash{}input\{x\}\textbackslash{}x1b [m]" in text
    )
    assert r"\textbackslash{}x1b[31mred" in text
    assert "% one two\n" in text
    assert formats.tabular_line(["[1mm]", "2"]) == r"{}[1mm] & 2 \\"


def test_no_control_character_reaches_a_table_or_a_terminal(results):
    """Not in files, formats, text or the page; what a label has is shown as an escape sequence."""
    path = str(results.path)
    for form in ("text", "csv", "markdown", "latex"):
        said = CliRunner().invoke(main, ["show", path, "--format", form]).output
        assert not CONTROLS.search(said.replace("\n", "")), form
    assert SHOWN in (results.path / "cells.csv").read_text()
    assert not CONTROLS.search(" ".join(results.lanes["defence"]))
    Folder(results.path / "none\x1b[2J").write_manifest()
    assert "\x1b" not in CliRunner().invoke(main, ["show", f"{path}/none\x1b[2J"]).output


def test_a_spreadsheet_computes_no_label(results):
    """Its text has an apostrophe in CSV files; Python reads it without; fits find their cells."""
    assert f"\n1,'{FORMULA}," in (results.path / "cells.csv").read_text()
    assert f",'{FORMULA}," in formats.in_format(summary_columns(results), "csv")
    assert results.cells["defence"].unique().tolist() == [FORMULA, SHOWN]


@settings(max_examples=15)
@given(
    st.lists(
        st.text(st.sampled_from("=+-@'a1.e\t")) | st.sampled_from(["-1.5", "'=x", "''-"]),
        min_size=1,
    )
)
def test_a_table_reads_back_as_it_was(texts):
    """Text and titles, however many apostrophes they begin with; text begins no formula."""
    texts = [f"{text}|" for text in texts]
    table = pd.DataFrame({"=title": texts, "number": -1.5})
    file = UPath("memory://labels/table.csv")
    file.write_text(csv_text(table))
    pd.testing.assert_frame_equal(read_table(file), table)
    assert csv_text(table).startswith("'=title,number\n")
    assert not re.search(r'^"?[=+\-@]', csv_text(table), re.MULTILINE)
    assert ",-1.5" in csv_text(table)


def test_a_column_more_on_a_wide_table_warns_of_nothing():
    """Pandas warns of more than 100 blocks; tests make an error of a warning."""
    file, wide = UPath("memory://labels/wide.csv"), pd.DataFrame(np.ones((2, 130))).add_prefix("c")
    file.write_text(csv_text(wide))
    assert read_table(file).assign(more=1.0).shape == (2, 131)


def test_what_is_no_formula_is_drawn_as_text(results):
    """A formula that matplotlib cannot read, in any label; one that it can is a formula."""
    for figure in (results.plot.curve(), results.plot.heat(), results.plot.tails()):
        figure.savefig(io.BytesIO(), format="svg")
    axis = results.plot.curve().axes[0].xaxis.label
    assert "\\bar{a$" in axis.get_text().replace("\n", " ")
    assert not axis.get_parse_math()
