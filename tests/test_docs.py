"""What README.md and docs/tutorial.md show is run, with fewer lanes; of others code runs, commands parse.

The pages of keys and commands name all that there are, links lead somewhere, and the site is built.
"""

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
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.config.schema import schema_text
from jaxnet.runs import watched
from jaxnet.statistics import fits
from jaxnet.view.figures import every

ROOT = Path(__file__).parents[1]
NOTEBOOK_FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(NOTEBOOK_FOLDER.glob("*.ipynb"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
MATHEMATICAL = ["guarantees", "model", "numerics", "rounds", "theorems"]
READABLE = [page.stem for page in PAGES if page.stem != "README"]

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
    """Somebody who does what a page says, from its first line to its last, in a folder with the configs."""

    def __init__(self, home):
        self.home, self.said, self.done = home, [], []
        self.write("configs/quick.yaml", (ROOT / "configs" / "quick.yaml").read_text())

    def write(self, name, text):
        """A file as the page shows it; a module stands beside the configs."""
        path = self.home / name
        path.parent.mkdir(exist_ok=True)
        if path.suffix == ".yaml":  # a second long, without an integrator
            text += "".join(
                f"{key}: {value}\n" for key, value in SHORT.items() if f"\n{key}:" not in text
            )
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


class Skimmer(Reader):
    """Somebody who runs scripts, but only looks whether a study loads and a command is one."""

    def yaml(self, code):
        """A study that loads."""
        super().yaml(code)
        self.done.append(jaxnet.load(NAMED.findall(code)[0]).config.name)

    def jaxnet(self, words, refused):
        """A command with arguments and options that it has."""
        command = main.commands[words[0]]
        command.make_context(words[0], words[1:])
        self.done.append(words[0])


@pytest.fixture
def reader(tmp_path, monkeypatch):
    """A reader in an empty folder, without figures and lanes of the page, which are tested elsewhere."""
    monkeypatch.setattr(fits, "RESAMPLES", 2)
    monkeypatch.setattr(every, "draw_figures", lambda *_, **__: iter(()))
    monkeypatch.setattr(watched, "replay_watched", lambda *_, **__: iter(()))
    monkeypatch.setattr(sys, "path", [*sys.path])  # where modules beside the config are found
    monkeypatch.delitem(sys.modules, "my_kinds", raising=False)  # of another test
    monkeypatch.chdir(tmp_path)
    yield Reader(tmp_path)
    sys.modules.pop("my_kinds", None)


def test_what_the_readme_shows_works(reader):
    """The study, every command, the script, and the defence of one's own in the sentence after it."""
    page = (ROOT / "README.md").read_text()
    reader.reads(page)
    assert reader.done == ["check", "run", "fit", "report", "show", "replay", "python"]
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


@pytest.mark.parametrize(
    "name",
    ["api", "config", "gallery", "install", "performance", "results", "sensitivity", "validation"],
)
def test_what_other_pages_show_can_be_done(name, reader, tmp_path):
    """Pages with code that no other test runs."""
    text = (ROOT / "docs" / f"{name}.md").read_text()
    done = Skimmer(tmp_path).reads(text).done
    assert len(done) == len(re.findall(r"^    jaxnet |^```(?:yaml|python)$", text, re.M))


def named_commands(text):
    """Commands in running text and tables: name, and the options after it."""
    for name, rest in re.findall(r"`jaxnet ([a-z]+)([^`]*)`", text):
        yield name, re.findall(r"(?<=\s)-[-\w]+", rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_running_text_exist(page):
    """With the options that stand beside them."""
    for name, options in named_commands(page.read_text()):
        known = {option for param in main.commands[name].params for option in param.opts}
        assert set(options) <= known, name


def test_the_install_page_names_python_versions_and_extras():
    """Each extra of pyproject.toml, no other, and the versions that it allows."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "docs" / "install.md").read_text()
    extras = text.partition("## Extras")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", extras, re.M)) == set(project["optional-dependencies"])
    versions = re.findall(r"Python :: (3\.\d+)", "".join(project["classifiers"]))
    assert f"needs Python {', '.join(versions[:-1])} or {versions[-1]}." in text
    assert f"distribution is `{project['name']}`" in text


def test_the_page_of_commands_names_each_with_all_it_takes():
    """In its section the options, and what a choice offers; none that there are not."""
    text = (ROOT / "docs" / "commands.md").read_text()
    sections = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", text, re.M | re.S))
    assert set(main.commands) == {name for name, _ in named_commands(text)}
    for name, command in main.commands.items():
        said = "".join(words for title, words in sections.items() if name in title.split(", "))
        options = [param for param in command.params if isinstance(param, click.Option)]
        assert {option for param in options for option in param.opts if option[:2] == "--"} <= set(
            re.findall(r"`(--[\w-]+)", said)
        ), name
        offered = [
            choice for param in command.params for choice in getattr(param.type, "choices", ())
        ]
        assert all(f"`{choice}`" in said or f" {choice}`" in said for choice in offered), name
    known = {
        option
        for command in main.commands.values()
        for param in command.params
        for option in param.opts
    }
    assert set(re.findall(r"--[a-z][\w-]*", text)) <= {*known, "--help", "--version"}


def test_shells_complete_what_the_page_says():
    """Each prints its script; commands, options, choices and paths are offered."""
    text = (ROOT / "docs" / "commands.md").read_text()
    shells = re.findall(r"_JAXNET_COMPLETE=(\w+)_source jaxnet", text)
    assert shells == ["bash", "zsh", "fish"]
    for shell in shells:
        script = CliRunner().invoke(
            main,
            prog_name="jaxnet",
            env={"_JAXNET_COMPLETE": f"{shell}_source"},
            catch_exceptions=False,
        )
        assert f"_JAXNET_COMPLETE={shell}_complete" in script.output
    for words, offered in {
        "jaxnet rep": "plain,replay\nplain,report\n",
        "jaxnet run --sh": "plain,--shard\n",
        "jaxnet show --format l": "plain,latex\n",
        "jaxnet report res": "file,res\n",
    }.items():
        asked = {"_JAXNET_COMPLETE": "bash_complete", "COMP_WORDS": words}
        asked["COMP_CWORD"] = str(words.count(" "))
        assert CliRunner().invoke(main, prog_name="jaxnet", env=asked).output == offered


def test_the_tables_of_keys_are_current():
    """`python docs/site/keys.py`; they have every key, and every key says what it is."""
    page = (ROOT / "docs" / "config.md").read_text()
    assert runpy.run_path(str(ROOT / "docs" / "site" / "keys.py"))["current"](page) == page
    whole = json.loads(schema_text())
    spelled = {
        "Uniform",
        "Normal",
        "DiscreteChoice",
        "Linspace",
        "Geomspace",
        "Samples",
        "WorstLanes",
    }
    spelled |= {
        "DrawnVehicles",
        "Apiece",
        "Shared",
        "NearestSources",
        "ShareOfLinks",
        "ShareOfVehicles",
    }
    spelled |= {"ChosenVehicles", "ChangingVehicles", "EachIn", "Sequential", "VehicleGains"}
    models = [whole, *(model for name, model in whole["$defs"].items() if name not in spelled)]
    for model in models:
        for key, node in model.get("properties", {}).items():
            if key not in ("kind", "label"):
                assert re.search(r"\w", node["description"])
                assert re.search(
                    rf"^\| `{key}` \|.*{re.escape(node['description'])} \|$", page, re.M
                ), key


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built so that a dead link or a name that is not there ends it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder


def test_the_site_has_the_interface_and_asks_nothing_of_the_network(site):
    """All that jaxnet exports; scripts and styles from beside the page; fonts within the styles."""
    assert (
        set(re.findall(r"url\((?!data:)", (site / "site/katex/katex.min.css").read_text())) == set()
    )
    page = (site / "api.html").read_text()
    headings = re.findall(r'<h3 id="([\w.]+)" class="doc.*?</h3>', page, re.S)
    assert {f"jaxnet.{name}" for name in jaxnet.__all__} <= set(headings)
    for path in site.rglob("*.html"):
        assert (
            re.findall(
                r"<(?:script|link|img)[^>]*(?:src|href)=\"?(?:https?:)?//[^>]*>", path.read_text()
            )
            == []
        )


def test_names_of_the_interface_can_be_imported_as_the_site_prints_them(site):
    """A heading of the page shows the whole path of its function or class."""
    headings = re.findall(
        r'<h3 id="[\w.]+" class="doc.*?</h3>', (site / "api.html").read_text(), re.S
    )
    shown = [re.search(r"[\w.]+", re.sub(r"<[^>]+>", "", heading))[0] for heading in headings]
    assert len(shown) > len(jaxnet.__all__)
    assert [name for name in shown if not name.startswith("jaxnet.")] == []
    for name in shown:
        assert callable(pkgutil.resolve_name(name)), name


@pytest.mark.parametrize("name", [path.stem for path in NOTEBOOKS])
def test_a_notebook_is_a_page_of_the_site(name, site, browser):
    """With its figures, tables in the site's style, and the notebook itself; links lead to the page."""
    page = browser.new_page()
    page.goto((site / "index.html").as_uri())
    page.locator(f"article a[href='notebooks/{name}.html']").click()
    page.wait_for_url(f"**/notebooks/{name}.html", wait_until="load")
    for figure in page.locator("article img").all():
        assert figure.evaluate("figure => figure.complete && figure.naturalWidth") > 100
        assert "png" not in figure.get_attribute("alt")
    assert page.locator("article img").count() > 0
    assert page.locator("article table:not([class])").count() > 0
    stored = page.locator("a[download]").get_attribute("href")
    assert (site / "notebooks" / stored).read_bytes() == (NOTEBOOK_FOLDER / stored).read_bytes()
    page.close()


def test_the_site_is_searched_from_the_disk(site, browser):
    """Without a server, and without the network."""
    page, asked = browser.new_page(), []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((site / "index.html").as_uri())
    page.locator(".md-search__input").click()
    page.keyboard.type("navigator_weight")
    page.locator(".md-search-result__link[href*='config.html']").first.wait_for()
    assert {url.partition(":")[0] for url in asked} <= {"file", "data"}


@pytest.mark.parametrize("words", ["packet loss", "GPU", "adjacency matrix", "install"])
def test_the_search_finds_what_readers_ask_for(words, site, browser):
    """A result has every word marked."""
    page = browser.new_page()
    page.goto((site / "index.html").as_uri())
    page.locator(".md-search__input").click()
    page.keyboard.type(words)
    page.locator(".md-search-result__link").first.wait_for()
    marked = page.locator(".md-search-result__article mark").all_inner_texts()
    assert {word.lower() for word in words.split()} <= {mark.lower() for mark in marked}
    page.close()


@pytest.mark.parametrize("name", MATHEMATICAL)
def test_formulas_are_typeset_from_the_disk(name, site, browser):
    """Every formula becomes KaTeX without an error, with its fonts, and asks nothing of the network."""
    page, asked = browser.new_page(), []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((site / f"{name}.html").as_uri())
    page.evaluate("document.fonts.ready")
    assert (
        page.locator(".arithmatex").count()
        == page.locator(".arithmatex > :is(.katex, .katex-display)").count()
    )
    assert page.locator(".katex").count() > 20
    assert page.locator(".katex-error").count() == 0
    assert page.evaluate("[...document.fonts].some(font => font.status === 'loaded')")
    assert not page.evaluate("[...document.fonts].some(font => font.status === 'error')")
    shown = page.locator("article").text_content()
    assert re.findall(r"\$|</?details|\*\*|## ", shown) == []  # marks that were not understood
    assert {url.partition(":")[0] for url in asked} <= {"file", "data"}
    page.close()


def test_a_switch_makes_the_site_dark(site, browser):
    """And light again; the choice holds on the next page."""
    page = browser.new_page(color_scheme="light")
    page.goto((site / "model.html").as_uri())
    scheme = page.locator("body[data-md-color-scheme]")
    assert scheme.get_attribute("data-md-color-scheme") == "default"
    page.locator("label[title=Dark]").click()
    assert scheme.get_attribute("data-md-color-scheme") == "slate"
    page.goto((site / "theorems.html").as_uri())
    assert scheme.get_attribute("data-md-color-scheme") == "slate"
    page.locator("label[title=Light]").click()
    assert scheme.get_attribute("data-md-color-scheme") == "default"
    page.close()


def prose(text):
    """The text without displayed formulas, tables, code blocks and comments."""
    text = re.sub(r"^```.*?^```$|^[> ]*\$\$.*?\$\$$|<!--.*?-->", "", text, flags=re.M | re.S)
    return re.sub(r"^[> ]*\|.*\|$", "", text, flags=re.M)


def paragraphs(text):
    """Paragraphs and items of lists; a formula in a line counts as one word."""
    one_word = re.sub(r"\$[^$]+\$", "x", prose(text))
    return re.split(r"^[> ]*$|^(?=[> ]*(?:[-*]|\d+\.) )|^#.*$", one_word, flags=re.M)


@pytest.mark.parametrize("name", READABLE)
def test_paragraphs_and_lines_are_short(name):
    """At most 120 words and 100 characters; rows of tables and lines of one link may be longer."""
    text = (ROOT / "docs" / f"{name}.md").read_text()
    assert [words for words in paragraphs(text) if len(words.split()) > 120] == []
    lines = text.splitlines()
    free = re.compile(r"[> ]*(\|.*\||[-*]? ?!?\[[^]]*\]\([^)]*\)\W*)")
    assert [line for line in lines if len(line) > 100 and not free.fullmatch(line)] == []


@pytest.mark.parametrize("name", READABLE)
def test_headings_are_frequent(name):
    """At most 250 words under one heading; proofs are folded and do not count."""
    text = re.sub(
        r"<details.*?</details>", "", (ROOT / "docs" / f"{name}.md").read_text(), flags=re.S
    )
    sections = re.split(r"^#+ .*$", text, flags=re.M)
    assert [
        text for text in sections if sum(len(words.split()) for words in paragraphs(text)) > 250
    ] == []


def test_facts_that_code_cites_are_on_the_page():
    """`theorems.md O5` in a docstring leads to the heading O5 there."""
    cited = set()
    for folder in ("jaxnet", "tests", "experiments"):
        for path in (ROOT / folder).rglob("*.py"):
            for page, labels in re.findall(
                r"(theorems|numerics)\.md\s(O\d+b?(?:(?:, | and )O\d+b?)*)", path.read_text()
            ):
                cited |= {(page, label) for label in re.findall(r"O\d+b?", labels)}
    assert len(cited) > 10
    for page, label in cited:
        assert f"\n## {label}: " in (ROOT / "docs" / f"{page}.md").read_text(), (page, label)


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
