"""`python -m jaxnet` is the command `jaxnet`."""

from jaxnet.cli import main

main(prog_name="jaxnet")
