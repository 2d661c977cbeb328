"""What a release consists of: files that agree, the paper, the recipe for conda, the badge."""

import re
import runpy
import shutil
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PAPER = (ROOT / "paper" / "paper.md").read_text()
BIBLIOGRAPHY = (ROOT / "paper" / "paper.bib").read_text()
IN_CONDA = {  # names of packages that conda-forge spells otherwise
    "flatbuffers": "python-flatbuffers",
    "matplotlib": "matplotlib-base",
    "universal-pathlib": "universal_pathlib",
}
DATED = ("jaxnet/version.py", "CHANGELOG.md", "CITATION.cff", "packaging/conda/recipe.yaml")


@pytest.fixture(scope="module")
def release():
    """The program that makes a release."""
    return runpy.run_path(str(ROOT / "packaging" / "release.py"))


def test_versions_agree(release):
    """What may be missing before a release is its day alone."""
    found = [each for each in release["faults"](ROOT) if " version " in each]
    assert found == []


@pytest.fixture
def tree(tmp_path):
    """The files that a release compares, with a day."""
    for name in DATED:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    changelog, citation = tmp_path / "CHANGELOG.md", tmp_path / "CITATION.cff"
    text = changelog.read_text()
    changelog.write_text(
        re.sub(r"^(## \S+) \(.*\)$", r"\1 (2026-12-01)", text, count=1, flags=re.M)
    )
    lines = [line for line in citation.read_text().splitlines() if "date-released" not in line]
    citation.write_text("\n".join([*lines, "date-released: 2026-12-01"]) + "\n")
    return tmp_path


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("CITATION.cff", "date-released: 2026-12-01", "", "CITATION.cff: date-released missing"),
        ("CITATION.cff", "2026-12-01", "2026-12-02", "CITATION.cff: date-released 2026-12-02"),
        ("CHANGELOG.md", "(2026-12-01)", "(unreleased)", "CHANGELOG.md: 0.1.0 is unreleased"),
        ("CHANGELOG.md", "## 0.1.0 (", "## 0.2.0 (", "CHANGELOG.md: version 0.2.0"),
        ("packaging/conda/recipe.yaml", '"0.1.0"', '"0.2.0"', "recipe.yaml: version 0.2.0"),
        ("jaxnet/version.py", "0.1.0", "0.3.0", "expected: 0.3.0"),
    ],
)
def test_a_release_is_refused_where_files_disagree(release, tree, name, old, new, says):
    """Each fault names the file and what is expected; without one there is none."""
    assert release["faults"](tree) == []
    path = tree / name
    path.write_text(path.read_text().replace(old, new))
    assert any(says in each for each in release["faults"](tree))


@pytest.mark.long
def test_a_release_has_wheel_sdist_site_and_checksums(release, tmp_path):
    """Built offline from a copy; the sdist has all that tests and pages need."""
    ignored = shutil.ignore_patterns(".*", "results", "dist", "site", "__pycache__")
    root = shutil.copytree(ROOT, tmp_path / "tree", ignore=ignored)
    shutil.copytree(ROOT / "docs" / "site", root / "docs" / "site", dirs_exist_ok=True)
    (root / "site").mkdir()
    (root / "site" / "index.html").write_text("<title>jaxnet</title>")
    made = {path.name for path in release["build"](root, root / "dist")}
    assert made == {
        "jaxnet_sim-0.1.0-py3-none-any.whl",
        "jaxnet_sim-0.1.0.tar.gz",
        "jaxnet-0.1.0-site.zip",
    }
    listed = (root / "dist" / "SHA256SUMS").read_text().splitlines()
    assert {line.split()[1] for line in listed} == made
    shutil.unpack_archive(root / "dist" / "jaxnet_sim-0.1.0.tar.gz", tmp_path)
    inside = tmp_path / "jaxnet_sim-0.1.0"
    assert all((inside / name).exists() for name in (*DATED, "Makefile", "paper/paper.bib"))


def test_the_recipe_for_conda_asks_for_what_the_project_asks_for():
    """Each dependency with its versions, and Python's."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text())
    asked = {"python": project["requires-python"]}
    for each in project["dependencies"]:
        name, versions = re.fullmatch(r"([\w-]+)(\S+)", each).groups()
        asked[IN_CONDA.get(name, name)] = versions
    assert asked == dict(each.split(" ") for each in recipe["requirements"]["run"])
    assert recipe["package"]["name"] == project["name"]
    assert recipe["about"]["license"] == project["license"]
    assert recipe["about"]["summary"] == project["description"]
    (command,) = project["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [" = ".join(command)]


def entries():
    """Entries of the bibliography: name and text."""
    return dict(re.findall(r"^@\w+\{(\w+),\n(.*?)^\}", BIBLIOGRAPHY, re.M | re.S))


def test_the_paper_cites_all_of_its_bibliography_and_nothing_else():
    """Each entry can be found by a DOI, an arXiv number or an address, but for the manuscript."""
    body = PAPER.split("---\n", 2)[2]
    assert set(re.findall(r"@(\w+)", body)) == set(entries())
    sought = re.compile(r"^  (?:doi|eprint|url) = \{\S+\}", re.M)
    assert [name for name, text in entries().items() if not sought.search(text)] == ["wafi"]


def test_the_paper_has_the_sections_and_the_length_that_the_journal_asks_for():
    """750 to 1,750 words; the authors are those of the citation."""
    _, head, body = PAPER.split("---\n", 2)
    assert 750 <= len(body.split()) <= 1750
    sections = ["Summary", "Statement of need", "State of the field", "Software design"]
    assert re.findall(r"^# (.*)$", body, re.M) == [*sections, "Research impact", "References"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    given, cited = yaml.safe_load(head), citation["references"][0]
    assert [each["name"] for each in given["authors"]] == [
        each["name"] for each in citation["authors"]
    ]
    assert given["title"] == citation["title"]
    families = re.findall(r"([\w-]+), ", entries()["wafi"].partition("title")[0])
    assert families == [each["family-names"] for each in cited["authors"]]
    assert f"{{{cited['title']}}}" in entries()["wafi"]


def test_numbers_of_the_paper_are_those_of_the_pages():
    """Speeds and errors of peers stand in a row of docs/performance.md with the same numbers."""
    rows = re.findall(r"^\| ([^|]+) \| ([\d.,]+) \| ([\de.-]+) \|$", PAPER, re.M)
    page = (ROOT / "docs" / "performance.md").read_text()
    assert len(rows) == 5
    for _, speed, error in rows:
        assert re.search(rf"^\|.*\| none \|.*\| {re.escape(speed)} \(.*\| {error} \|", page, re.M)


def test_a_notebook_s_badge_asks_no_host():
    """A picture and a link that are paths in the repository, so that any host shows them."""
    readme = (ROOT / "README.md").read_text()
    badges = re.findall(r"\[!\[Notebook\]\((\S+)\)[^\]]*\]\((\S+\.ipynb)\)", readme)
    names = {path.name for path in (ROOT / "docs" / "notebooks").glob("*.ipynb")}
    assert {Path(target).name for _, target in badges} == names
    assert all((ROOT / path).is_file() for badge in badges for path in badge)
