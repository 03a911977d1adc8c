"""A command as its own process would answer it, without the second that the start of one takes."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import SimpleNamespace

from click.testing import CliRunner


def tcbench(*words: object, cwd: Path | None = None) -> SimpleNamespace:
    """returncode, stdout and stderr of `tcbench WORDS` in the folder `cwd`; what would be a traceback is raised."""
    from tcbench import plugins
    from tcbench.cli import main

    if plugins.plugin_folders():
        plugins.forget()  # of the command before
    with contextlib.chdir(cwd or "."):
        done = CliRunner().invoke(main, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return SimpleNamespace(returncode=done.exit_code, stdout=done.stdout, stderr=done.stderr)
