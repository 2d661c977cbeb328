"""KaTeX's fonts stand inside its style sheet: some browsers read no font file from the disk."""

import base64
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

KATEX = Path(__file__).parent / "katex"
SHEET = "site/katex/katex.min.css"
FONT = re.compile(
    r'url\((fonts/[\w-]+\.woff2)\) format\("woff2"\)(?:,url\([^)]*\) format\("\w+"\))*'
)


def on_files(files: Any, config: Any) -> Any:
    """Replace the style sheet by one that has its fonts inside."""
    files.remove(files.get_file_from_path(SHEET))
    files.append(
        File.generated(config, SHEET, content=with_fonts((KATEX / "katex.min.css").read_text()))
    )
    return files


def with_fonts(sheet: str) -> str:
    """Return the style sheet with each font as a data URL."""
    return FONT.sub(lambda found: f'url({data_url(KATEX / found[1])}) format("woff2")', sheet)


def data_url(font: Path) -> str:
    """Return the file of a font as a data URL."""
    return "data:font/woff2;base64," + base64.b64encode(font.read_bytes()).decode()
