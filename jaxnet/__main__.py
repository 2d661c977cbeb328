"""`python -m jaxnet` is the command `jaxnet`; it imports nothing from the current folder either."""

import contextlib
import sys
from pathlib import Path

if not sys.flags.safe_path and not Path("jaxnet").is_dir():  # Python has put the folder first
    with contextlib.suppress(ValueError):
        sys.path.remove(str(Path.cwd()))

from jaxnet.cli import main

main(prog_name="jaxnet")
