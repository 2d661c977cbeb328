"""The docs: code runs, commands parse, links lead somewhere, generated tables are current."""

import json
import pkgutil
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.config.schema import schema_text
from jaxnet.runs import watched
from jaxnet.statistics import fits
from jaxnet.view.figures import every

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
MATHEMATICAL = ["guarantees", "model", "numerics", "rounds", "theorems"]

# A fenced block with its language, or the lines of an indented one.
CODE = re.compile(r"^```(\w*)\n(.*?)^```$|((?:^    [^\n]*\n)+)", re.M | re.S)
NAMED = re.compile(r"# (?:jaxnet \w+ )?(\S+\.(?:py|yaml))\n")  # the first line of what is a file
LINK = re.compile(r"\]\(([^()\s]+)\)")
SHORT = {"horizon": "1.0", "tail": "0.5", "engine": "exact"}


def small(text):
    """The same with two topologies and four samples, also where their number depends on a width."""
    text = re.sub(r"(\bsamples\"?[:=] ?)\d+", r"\g<1>4", text)
    text = re.sub(r"half_width: [\d.]+", "half_width: 0.49, at_most: 4", text)
    return text.replace("[star, cyclic, path]", "[star, cyclic]")


class Reader:
    """Does what a page says, from its first line to its last, in a folder with the configs."""

    def __init__(self, home):
        self.home, self.said, self.done = home, [], []
        for name in ("configs/quick.yaml", "configs/agreement.yaml"):
            self.write(name, (ROOT / name).read_text())

    def write(self, name, text):
        """A file as the page shows it; a study is a second long, without an integrator."""
        path = self.home / name
        path.parent.mkdir(exist_ok=True)
        if path.suffix == ".yaml":
            given = [f"{key}: {value}\n" for key, value in SHORT.items() if f"\n{key}:" not in text]
            text += "".join(given)
        path.write_text(small(text))

    def reads(self, page):
        for language, code, indented in CODE.findall(page):
            getattr(self, language or "shell")(code or indented)
        return self

    def yaml(self, code):
        """A study, named by its first line."""
        self.write(NAMED.findall(code)[0], code)

    def python(self, code):
        """A script, or a module that a config names."""
        name = (NAMED.findall(code) or ["script.py"])[0]
        if "import jaxnet\n" not in code:
            self.write(f"configs/{name}", code)
            return
        self.write(name, code)
        runpy.run_path(name)
        self.done.append("python")

    def shell(self, lines):
        """Commands; those after a prompt stand with what they print."""
        for line in lines.splitlines():
            prompt, command = re.match(r"    (\$ )?(.*)", line).groups()
            if prompt:
                self.said = [shown[4:] for shown in lines.splitlines()[1:]]
            if command.startswith("jaxnet "):
                self.jaxnet(shlex.split(small(command), comments=True)[1:], bool(prompt))

    def jaxnet(self, words, refused):
        """One command, in this process; a run with `--out` is checked alone."""
        if words[-2] == "--out":
            words = ["check", *words[1:-2]]
        answer = CliRunner().invoke(main, words)
        assert answer.exit_code == (2 if refused else 0), (words, answer.output)
        assert not refused or answer.output.splitlines() == self.said
        self.done.append(words[0])


class Skimmer(Reader):
    """Runs scripts, but only looks whether a study loads and a command has these options."""

    def yaml(self, code):
        super().yaml(code)
        self.done.append(jaxnet.load(NAMED.findall(code)[0]).config.name)

    def jaxnet(self, words, refused):
        main.commands[words[0]].make_context(words[0], words[1:])
        self.done.append(words[0])


@pytest.fixture
def home(tmp_path, monkeypatch):
    """An empty folder. Figures and replayed lanes, which other tests have, are left out."""
    monkeypatch.setattr(fits, "RESAMPLES", 2)
    monkeypatch.setattr(every, "draw_figures", lambda *_, **__: iter(()))
    monkeypatch.setattr(watched, "replay_watched", lambda *_, **__: iter(()))
    monkeypatch.setattr(sys, "path", [*sys.path])  # where modules beside the config are found
    monkeypatch.delitem(sys.modules, "my_kinds", raising=False)  # of another test
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("my_kinds", None)


def test_what_the_readme_shows_works(home):
    """The study, every command, the script, and the defence of one's own."""
    page = (ROOT / "README.md").read_text()
    reader = Reader(home).reads(page)
    assert reader.done == ["check", "run", "fit", "report", "show", "replay", "python"]
    (command,) = re.findall(r"^`jaxnet (run .*?)`", page, re.M)
    *words, _, folder = shlex.split(command)
    assert folder == "results/within"
    reader.jaxnet([*words, "--fresh"], refused=False)
    shown = re.search(r"```yaml\n(.*?)```", page, re.S)[1].splitlines()
    given = (ROOT / "configs" / "quick.yaml").read_text().splitlines()
    assert shown == [line for line in given if "language-server" not in line]


def test_the_config_begins_with_sixteen_keys_and_a_study_that_has_them_and_runs(home):
    """Each key of the table is in the study, or swept there."""
    page = (DOCS / "config.md").read_text()
    begin = page.partition("\n## Sixteen keys")[2].partition("\n## ")[0]
    keys = re.findall(r"^\| `([\w.]+)` \|", begin, re.M)
    assert len(keys) == 16
    reader = Reader(home).reads(begin.replace("horizon: 90", "horizon: 9"))
    assert reader.done == ["check", "run"]
    given = yaml.safe_load((home / "ring.yaml").read_text())
    named = {*given, *given["sweep"], *(f"attack.{key}" for key in given["attack"])}
    assert set(keys) <= named
    assert "unrecovered" in jaxnet.open("results/ring").cells


def test_the_study_of_alarms_that_cut_runs_and_cutting_helps(home):
    """The error of the lie, by what alarms cut; four lanes a cell."""
    page = (DOCS / "acting.md").read_text()
    section = page.partition("\n## Try it")[2].partition("\n## ")[0]
    assert Reader(home).reads(section).done == ["run"]
    cells = jaxnet.open("results/cuts").cells.set_index(["attack.magnitude", "detector.cuts"])
    errors = cells["tail_mean_median"][0.5]
    assert errors["never"] == pytest.approx(0.750, rel=0.02)
    assert errors[["message", "link"]].max() < 0.1


@pytest.mark.long
def test_what_the_tutorial_shows_works(home):
    """From the first check to the figure; the faulty study is refused in these words."""
    reader = Reader(home).reads((DOCS / "tutorial.md").read_text())
    assert reader.done.count("check") == 6
    assert {"run", "show", "replay", "fit", "report", "python"} < set(reader.done)
    assert (home / "errors.pdf").stat().st_size > 1000


def test_the_tutorial_shows_what_check_prints():
    """Line by line, at 80 columns."""
    section = (DOCS / "tutorial.md").read_text().split("\n## ")[2]
    command, *shown = re.findall(r"^    (.*)$", section, re.M)
    assert command == "jaxnet check configs/quick.yaml"
    config = str(ROOT / "configs" / "quick.yaml")
    printed = CliRunner().invoke(main, ["check", config], env={"COLUMNS": "80"}).output.splitlines()
    assert len(shown) == 8
    assert [line for line in shown if line not in printed] == []


def alike(shown, printed):
    """Whether two lines have the same words, and numbers that agree to one part in a hundred."""
    number = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
    words = [re.split(number, " ".join(line.split())) for line in (shown, printed)]
    ours, theirs = ([float(each) for each in re.findall(number, line)] for line in (shown, printed))
    return words[0] == words[1] and ours == pytest.approx(theirs, rel=0.01)


@pytest.mark.long
def test_the_tutorial_shows_the_tables_that_run_show_and_fit_print(tmp_path, monkeypatch):
    """At 80 columns, its studies as they are: a line of the page is a line of the program."""
    monkeypatch.chdir(tmp_path)
    run, own, fit, _, meet = (DOCS / "tutorial.md").read_text().split("\n## ")[3:]
    Path("study.yaml").write_text(re.findall(r"```yaml\n(.*?)```", own, re.S)[0])
    commands = {
        run: [["run", str(ROOT / "configs" / "quick.yaml")], ["show", "results/quick"]],
        own: [["run", "study.yaml"], ["run", "study.yaml", "horizon=30", "--out", "results/short"]],
        fit: [["fit", "results/study"]],
        meet: [["run", str(ROOT / "configs" / "agreement.yaml")]],
    }
    for section, each in commands.items():
        said = [CliRunner().invoke(main, words, env={"COLUMNS": "80"}).output for words in each]
        printed = "".join(said).splitlines()
        blocks = [block for _, _, block in CODE.findall(section)]
        tables = [block for block in blocks if re.search("median|%|worst", block)]
        shown = "".join(tables).splitlines()
        assert len(shown) > 4
        assert [line for line in shown if not any(alike(line, each) for each in printed)] == []
        (warning,) = re.findall(r"^> (.*)$", section, re.M) or [""]
        assert warning in " ".join(" ".join(printed).split())


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("api", marks=pytest.mark.long),  # simulates
        *(
            "acting",
            "channel",
            "config",
            "detectors",
            "gallery",
            "install",
            "search",
            "sensitivity",
        ),
    ],
)
def test_what_other_pages_show_can_be_done(name, home):
    """Pages with code that no other test runs."""
    text = (DOCS / f"{name}.md").read_text()
    done = Skimmer(home).reads(text).done
    assert len(done) == len(re.findall(r"^    jaxnet |^```(?:yaml|python)$", text, re.M)) > 0


def options(command):
    """All that a command takes after a dash."""
    return {option for param in command.params for option in param.opts if option[0] == "-"}


def test_the_page_of_commands_names_each_with_all_it_takes():
    """In its section the options, and what a choice offers; none that there are not."""
    text = (DOCS / "commands.md").read_text()
    sections = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", text, re.M | re.S))
    assert set(main.commands) == set(re.findall(r"`jaxnet ([a-z]+)", text))
    for name, command in main.commands.items():
        said = sections.get(name, "")
        taken = [param for param in command.params if isinstance(param, click.Option)]
        long = {option for param in taken for option in param.opts if option[:2] == "--"}
        assert long <= set(re.findall(r"`(--[\w-]+)", said)), name
        offered = [each for param in command.params for each in getattr(param.type, "choices", ())]
        assert all(f"`{each}`" in said or f" {each}`" in said for each in offered), name
    known = set().union(*map(options, main.commands.values()))
    assert set(re.findall(r"--[a-z][\w-]*", text)) <= {*known, "--help", "--version"}


def test_the_install_page_names_python_versions_and_extras():
    """Each extra of pyproject.toml, no other, and the versions that it allows."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (DOCS / "install.md").read_text()
    extras = text.partition("## Extras")[2].partition("\n## ")[0]
    assert set(re.findall(r"^- `(\w+)`:", extras, re.M)) == set(project["optional-dependencies"])
    versions = re.findall(r"Python :: (3\.\d+)", "".join(project["classifiers"]))
    assert f"needs Python {', '.join(versions[:-1])} or {versions[-1]}." in text
    assert f"distribution is `{project['name']}`" in text


@pytest.fixture(scope="module")
def keys():
    """The program that writes the tables of keys."""
    return runpy.run_path(str(DOCS / "site" / "keys.py"))


def letters(text):
    """What is left of a text in a list: each word, without marks and the ends of lines."""
    return re.sub(r"[\W_]", "", text)


def test_the_lists_of_keys_are_current(keys):
    """`python docs/site/keys.py`; every key of every kind is there and says what it is."""
    page = (DOCS / "keys.md").read_text()
    assert keys["current"](page) == page
    whole = json.loads(schema_text())
    kinds = [model for model in whole["$defs"].values() if "kind" in model.get("properties", {})]
    for model in [whole, *kinds]:
        for key, node in model["properties"].items():
            if key not in ("kind", "label"):
                assert re.search(r"\w", node["description"])
                assert re.search(rf"^- `{key}`", page, re.M), key
                assert letters(node["description"]) in letters(page), key


def test_the_examples_of_the_config_load(keys, tmp_path):
    """One for each family."""
    needed = {  # by kinds of a family
        "detector": "channel: {noise: {position: 0.1}}",
        "filter": "vehicle: robotarium\nengine: sampled\nlaw: local\ngain: [1]",
    }
    for family, example in keys["EXAMPLES"].items():
        path = tmp_path / f"{family}.yaml"
        path.write_text(f"name: {family}\n{needed.get(family, '')}\n{example}\n")
        jaxnet.load(path)


def test_facts_that_code_cites_are_on_the_page():
    """`theorems.md O5` in a docstring leads to the heading with (O5) there."""
    reference = re.compile(r"(theorems|numerics)\.md\s(O\d+b?(?:(?:, | and )O\d+b?)*)")
    files = [*ROOT.glob("jaxnet/**/*.py"), *ROOT.glob("experiments/**/*.py")]
    found = [each for path in files for each in reference.findall(path.read_text())]
    cited = {(page, label) for page, labels in found for label in re.findall(r"O\d+b?", labels)}
    assert len(cited) > 10
    for page, label in cited:
        text = (DOCS / f"{page}.md").read_text()
        assert re.search(rf"^## .* \({label}\)$", text, re.M), (page, label)


def anchors(page):
    """Headings, as links name them, and anchors that are written out."""
    text = page.read_text()
    headings = re.findall(r"^#+ (.*)$", text, re.M)
    named = {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}
    return named | set(re.findall(r'<a id="([\w-]+)">', text))


def test_the_gallery_has_each_study():
    """Of `configs/`, by its name."""
    page = (DOCS / "gallery.md").read_text()
    studies = {path.stem for path in (ROOT / "configs").glob("*.yaml")}
    assert studies <= set(re.findall(r"\w+", page))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_what_there_is(page):
    """Commands with their options, files and headings; lines but rows and links are short."""
    text = page.read_text()
    for name, rest in re.findall(r"`jaxnet ([a-z]+)([^`]*)`", text):
        assert set(re.findall(r"(?<=\s)-[-\w]+", rest)) <= options(main.commands[name]), name
    for link in LINK.findall(text):
        path, _, heading = link.partition("#")
        if not re.match(r"\w+:", link):
            target = page.parent / path if path else page
            assert target.exists(), link
            assert not heading or heading in anchors(target), link
    row = re.compile(r".* \| .*|!?\[.*\)")
    long = [line for line in text.splitlines() if len(line) > 100]
    assert [line for line in long if not row.fullmatch(line)] == []


def test_each_page_begins_with_what_its_reader_can_do():
    """A short sentence in the imperative; no formula that all pages begin with."""
    pages = [page.read_text().split("\n\n")[1].replace("\n", " ") for page in PAGES[1:]]
    begin = re.compile(r"(?:\*For maintainers.*?\* )?(([A-Z]\w+\W+\w+)\b.*?\.) ")
    begins = [begin.match(f"{page} ") for page in pages]
    assert all(each and len(each[1].split()) <= 25 for each in begins)
    assert len({each[2] for each in begins if each}) > len(begins) / 2


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built so that a dead link or a name that is not there ends it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder


@pytest.fixture
def opened(site, browser):
    """Opens a page of the site, and allows no request to the network."""
    page, asked = browser.new_page(), []
    page.on("request", lambda request: asked.append(request.url))

    def open_page(name):
        page.goto((site / f"{name}.html").as_uri())
        return page

    yield open_page
    page.close()
    assert {url.partition(":")[0] for url in asked} <= {"file", "data"}


@pytest.mark.long
def test_the_site_has_the_interface_and_asks_nothing_of_the_network(site):
    """All that jaxnet exports, by paths that import; no script, style or image from elsewhere."""
    assert not re.search(r"url\((?!data:)", (site / "site/katex/katex.min.css").read_text())
    text = (site / "api.html").read_text()
    headings = re.findall(r'<h3 id="[\w.]+" class="doc.*?</h3>', text, re.S)
    shown = {re.search(r"[\w.]+", re.sub(r"<[^>]+>", "", heading))[0] for heading in headings}
    assert {f"jaxnet.{name}" for name in jaxnet.__all__} <= shown
    assert all(callable(pkgutil.resolve_name(name)) for name in shown)
    remote = re.compile(r"<(?:script|link|img)[^>]*(?:src|href)=\"?(?:https?:)?//[^>]*>")
    assert [path for path in site.rglob("*.html") if remote.search(path.read_text())] == []


@pytest.mark.long
@pytest.mark.parametrize("name", [path.stem for path in NOTEBOOKS])
def test_a_notebook_is_a_page_of_the_site(name, site, opened):
    """With its figures, tables in the site's style, and the notebook itself."""
    page = opened("index")
    page.locator(f"article a[href='notebooks/{name}.html']").click()
    page.wait_for_url(f"**/notebooks/{name}.html", wait_until="load")
    figures = page.locator("article img").all()
    assert figures
    for figure in figures:
        assert figure.evaluate("figure => figure.complete && figure.naturalWidth") > 100
        assert "png" not in figure.get_attribute("alt")
    assert page.locator("article table:not([class])").count() > 0
    stored = page.locator("a[download]").get_attribute("href")
    assert (site / "notebooks" / stored).read_bytes() == (DOCS / "notebooks" / stored).read_bytes()


@pytest.mark.long
def test_the_site_is_searched_from_the_disk(opened):
    """Without a server, and without the network."""
    page = opened("index")
    page.locator(".md-search__input").click()
    page.keyboard.type("navigator_weight")
    page.locator(".md-search-result__link[href*='keys.html']").first.wait_for()


@pytest.mark.long
@pytest.mark.parametrize("name", MATHEMATICAL)
def test_formulas_are_typeset_from_the_disk(name, opened):
    """Every formula becomes KaTeX without an error, with its fonts."""
    page = opened(name)
    page.evaluate("document.fonts.ready")
    typeset = page.locator(".arithmatex > :is(.katex, .katex-display)").count()
    assert page.locator(".arithmatex").count() == typeset > 20
    assert page.locator(".katex-error").count() == 0
    assert page.evaluate("[...document.fonts].some(font => font.status === 'loaded')")
    assert not page.evaluate("[...document.fonts].some(font => font.status === 'error')")
    shown = page.locator("article").text_content()
    assert re.findall(r"\$|</?details|\*\*|## ", shown) == []  # marks that were not understood
