"""README.md is the site's home, CHANGELOG.md a page; files that README links to come along."""

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
    for name in ("LICENSE", "CITATION.cff"):
        files.append(File.generated(config, name, content=(ROOT / name).read_text()))
    return files
