"""Each notebook in docs/notebooks/ is a page with its stored outputs, made by nbconvert."""

import re
from pathlib import PurePosixPath
from typing import Any

import nbformat
from mkdocs.structure.files import File
from nbconvert import MarkdownExporter

LINK = re.compile(r"\]\(((?:[\w.]+/)*\w+)\.ipynb\)")
STYLE = re.compile(r"<style scoped>.*?</style>\n?", re.S)


def on_files(files: Any, config: Any) -> Any:
    """Add a page and its images for each notebook; the notebook itself stays for a download."""
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        page = PurePosixPath(notebook.src_uri).with_suffix(".md")
        markdown, images = as_markdown(notebook.content_string, notebook.name)
        files.append(
            File.generated(config, str(page), content=with_download(markdown, notebook.name))
        )
        for name, content in images.items():
            files.append(File.generated(config, str(page.parent / name), content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Lead links to a notebook to its page."""
    return LINK.sub(r"](\1.md)", markdown)


def as_markdown(text: str, name: str) -> tuple[str, dict[str, bytes]]:
    """Return a notebook's Markdown, and its images by path from the page."""
    notebook: Any = nbformat.reads(text, as_version=4)
    naming = {"unique_key": name, "output_files_dir": f"{name}_files"}
    markdown, resources = MarkdownExporter().from_notebook_node(notebook, naming)
    return plain(markdown), resources["outputs"]


def plain(markdown: str) -> str:
    """Return the Markdown with tables in the site's style, not pandas', and words for images."""
    markdown = STYLE.sub("", markdown).replace('<table border="1" class="dataframe">', "<table>")
    return markdown.replace("![png]", "![Figure of the cell above]")


def with_download(markdown: str, name: str) -> str:
    """Return the page's Markdown with a link to the notebook below the title."""
    title, _, rest = markdown.lstrip().partition("\n")
    return f'{title}\n\n<a href="{name}.ipynb" download>Download this notebook</a>\n{rest}'
