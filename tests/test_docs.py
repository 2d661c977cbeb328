"""What README.md and docs/tutorial.md show is run, with fewer lanes; links of all pages lead somewhere."""

import re
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from jaxnet.cli import main
from jaxnet.statistics import fits
from jaxnet.statistics.families import MODELS
from jaxnet.view.figures import every

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

# A fenced block with its language, or the lines of an indented one.
CODE = re.compile(r"^```(\w*)\n(.*?)^```$|((?:^    [^\n]*\n)+)", re.M | re.S)
NAMED = re.compile(r"# (?:jaxnet \w+ )?(\S+\.(?:py|yaml))\n")  # the first line of what is a file
LINK = re.compile(r"\]\(([^()\s]+)\)")
SHORT = {"horizon": "1.0", "tail": "0.5", "engine": "exact"}


def small(text):
    """The same with four samples, also where their number depends on an interval's width, and two topologies;
    every lane counts as recovered, so the report replays none.
    """
    text = re.sub(r"(\bsamples\"?[:=] ?)\d+", r"\g<1>4", text)
    text = re.sub(r"half_width: [\d.]+", "half_width: 0.49, at_most: 4", text)
    return text.replace("tau: 0.01", "tau: 1.0e+9").replace("[star, cyclic, path]", "[star, cyclic]")


class Reader:
    """Somebody who does what a page says, from its first line to its last, in a folder with the configs."""

    def __init__(self, home):
        self.home, self.said, self.done = home, [], []
        self.write("configs/quick.yaml", (ROOT / "configs" / "quick.yaml").read_text())

    def write(self, name, text):
        """A file as the page shows it; a module stands beside the configs."""
        path = self.home / name
        path.parent.mkdir(exist_ok=True)
        if path.suffix == ".yaml":  # a second long, without an integrator
            text += "".join(f"{key}: {value}\n" for key, value in SHORT.items() if f"\n{key}:" not in text)
        path.write_text(small(text))

    def reads(self, page):
        """All code of a page, in order."""
        for language, code, indented in CODE.findall(page):
            if language:
                getattr(self, language)(code)
            else:
                self.shell(indented)
        return self

    def yaml(self, code):
        """A study, named by its first line."""
        (name,) = NAMED.findall(code)[:1]
        self.write(name, code)

    def python(self, code):
        """A module that a config names, or a script."""
        name = (NAMED.findall(code) or ["script.py"])[0]
        if "import jaxnet\n" not in code:
            return self.write(f"configs/{name}", code)
        self.write(name, code)
        runpy.run_path(name)
        self.done.append("python")
        return None

    def shell(self, lines):
        """Commands; those after a prompt stand with what they print."""
        for line in lines.splitlines():
            prompt, command = re.match(r"    (\$ )?(.*)", line).groups()
            if prompt:
                self.said = [shown[4:] for shown in lines.splitlines()[1:]]
            if command.startswith("jaxnet "):
                self.jaxnet(shlex.split(small(command), comments=True)[1:], bool(prompt))

    def jaxnet(self, words, refused):
        """One command, in this process; a run of the same study with other keys is checked alone."""
        if words[-2] == "--out":
            words = ["check", *words[1:-2]]
        answer = CliRunner().invoke(main, words)
        assert answer.exit_code == (2 if refused else 0), (words, answer.output)
        if refused:
            assert answer.output.splitlines() == self.said
        self.done.append(words[0])


@pytest.fixture
def reader(tmp_path, monkeypatch):
    """A reader in an empty folder. What takes long and is tested elsewhere, fits and figures, is left out."""

    def ones(ranked, counts, quantiles, models, effort):
        one = {model: np.ones((len(counts), len(MODELS[model]))) for model in models}
        return dict.fromkeys((None, *quantiles), one)

    monkeypatch.setattr(fits, "estimates", ones)
    monkeypatch.setattr(fits, "RESAMPLES", 2)
    monkeypatch.setattr(every, "draw", lambda *_: iter(()))
    monkeypatch.chdir(tmp_path)
    return Reader(tmp_path)


def test_what_the_readme_shows_works(reader):
    """The study, every command, the script, and the defence of one's own in the sentence after it."""
    page = (ROOT / "README.md").read_text()
    reader.reads(page)
    assert reader.done == ["check", "run", "fit", "report", "replay", "python"]
    (command,) = re.findall(r"^`jaxnet (run .*?)`", page, re.M)
    *words, _, folder = shlex.split(command)
    assert folder == "results/within"
    reader.jaxnet([*words, "--fresh"], refused=False)
    assert "# jaxnet run configs/quick.yaml\nname: quick\nsamples: 5\n" in page
    shown = re.search(r"```yaml\n(.*?)```", page, re.S)[1].splitlines()
    given = (ROOT / "configs" / "quick.yaml").read_text().splitlines()
    assert shown == [line for line in given if "language-server" not in line]


def test_what_the_tutorial_shows_works(reader):
    """From the first check to the figure; what is wrong with the faulty study is told in these words."""
    reader.reads((ROOT / "docs" / "tutorial.md").read_text())
    assert reader.done.count("check") == 7
    assert reader.done[-1] == "python"
    assert {"run", "show", "replay", "fit", "report"} < set(reader.done)
    assert (reader.home / "errors.pdf").stat().st_size > 1000


def anchors(page):
    """Headings, as links name them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    """To a file that is there, and to a heading of it."""
    for link in LINK.findall(page.read_text()):
        path, _, heading = link.partition("#")
        if not re.match(r"\w+:", link):
            target = page.parent / path if path else page
            assert target.exists(), link
            assert not heading or heading in anchors(target), link
