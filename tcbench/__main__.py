"""`python -m tcbench`."""

from .cli import main

main(prog_name="tcbench")
