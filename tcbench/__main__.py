"""`python -m tcbench`."""

import os
import sys

if sys.path and sys.path[0] in ("", os.getcwd()):  # what lies in the current folder is no part of tcbench
    del sys.path[0]

from .cli import main

main(prog_name="tcbench")
