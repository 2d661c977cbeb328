"""README.md is the site's home, CHANGELOG.md a page; files that pages link to come along."""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]


def on_files(files: Any, config: Any) -> Any:
    """Add them to the files of the site."""
    home = re.sub(r"\bdocs/(?=[\w/-]+\.(?:md|png|svg|ipynb))", "", (ROOT / "README.md").read_text())
    files.append(File.generated(config, "index.md", content=home))
    files.append(
        File.generated(config, "changelog.md", content=(ROOT / "CHANGELOG.md").read_text())
    )
    studies = [str(path.relative_to(ROOT)) for path in ROOT.glob("configs/**/*.yaml")]
    for name in ("LICENSE", "CITATION.cff", *studies):
        files.append(File.generated(config, name, content=(ROOT / name).read_text()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Lead links to a study to its copy on the site."""
    return markdown.replace("](../configs/", "](configs/")
