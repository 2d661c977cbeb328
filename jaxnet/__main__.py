"""`python -m jaxnet` is the command `jaxnet`: modules in the folder where it is typed are not found either."""

import os
import sys
from pathlib import Path

if sys.path[:1] == [os.getcwd()] and Path(__file__).parents[1] != Path.cwd():
    del sys.path[0]

from jaxnet.cli import main

main(prog_name="jaxnet")
