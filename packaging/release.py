"""Make a release in dist/: wheel, sdist, the site and checksums. `make release` runs this.

A release has one version in jaxnet/version.py, CHANGELOG.md, CITATION.cff and the recipe for conda,
and one date in CHANGELOG.md and CITATION.cff. Nothing is uploaded, and nothing outside is asked.
"""

import hashlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
DAY = r"\d{4}-\d{2}-\d{2}"


def main() -> None:
    """Check the files; without `--check` build the release too. Exit status 2 names the faults."""
    found = [*faults(ROOT), *uncommitted(ROOT)]
    if found:
        print(*found, sep="\n", file=sys.stderr)
        sys.exit(2)
    if "--check" not in sys.argv[1:]:
        for path in build(ROOT, ROOT / "dist"):
            print(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(ROOT)}")


def faults(root: Path) -> list[str]:
    """Versions and dates that disagree or are missing, a line each."""
    version = first(root / "jaxnet" / "version.py", r'^__version__ = "(.+)"$')
    day = first(root / "CHANGELOG.md", r"^## \S+ \((.+)\)$")
    found = [
        f"{name}: version {given}, expected: {version}, as in jaxnet/version.py"
        for name, given in {
            "CHANGELOG.md": first(root / "CHANGELOG.md", r"^## (\S+) \("),
            "CITATION.cff": first(root / "CITATION.cff", r"^version: (.+)$"),
            "packaging/conda/recipe.yaml": first(
                root / "packaging" / "conda" / "recipe.yaml", r'^  version: "(.+)"$'
            ),
        }.items()
        if given != version
    ]
    if not re.fullmatch(DAY, day):
        found.append(f"CHANGELOG.md: {version} is {day}, expected: the day, such as 2026-01-31")
    released = first(root / "CITATION.cff", r"^date-released: (.+)$")
    if released != day:
        found.append(f"CITATION.cff: date-released {released}, expected: {day}, as in CHANGELOG.md")
    return found


def first(path: Path, pattern: str) -> str:
    """The first match of a pattern in a file, or "missing"."""
    match = re.search(pattern, path.read_text(), re.MULTILINE)
    return match[1] if match else "missing"


def uncommitted(root: Path) -> list[str]:
    """Whether files differ from the commit; a tree without git has none."""
    if not (root / ".git").exists():
        return []
    status = ["git", "-C", str(root), "status", "--porcelain"]
    changed = subprocess.run(status, check=True, capture_output=True, text=True).stdout
    return ["git: some files are not committed"] if changed else []


def build(root: Path, folder: Path) -> list[Path]:
    """Build wheel and sdist, pack the site that `make docs` made, and write the checksums."""
    shutil.rmtree(folder, ignore_errors=True)
    hatch = [sys.executable, "-m", "hatchling", "build", "--directory", str(folder)]
    subprocess.run(hatch, check=True, cwd=root)
    version = first(root / "jaxnet" / "version.py", r'^__version__ = "(.+)"$')
    shutil.make_archive(str(folder / f"jaxnet-{version}-site"), "zip", root / "site")
    made = sorted(folder.iterdir())
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in made]
    (folder / "SHA256SUMS").write_text("".join(sums))
    return made


if __name__ == "__main__":
    main()
