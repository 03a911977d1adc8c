"""The gallery: every kind of chart has a picture, a command that the command line accepts, and a place on the page."""

import re
import shlex
from pathlib import Path

import pytest

from tcbench import cli
from tcbench.report.chart_kinds import kinds

TOP = Path(__file__).parents[2]
SCRIPT = (TOP / "results" / "gallery.sh").read_text()
PAGE = (TOP / "docs" / "gallery.md").read_text().replace("\\\n", " ")
DRAWN = [shlex.split(line)[1:] for line in SCRIPT.replace("\\\n", " ").splitlines() if line.startswith("draw ")]


def test_every_kind_has_a_picture_in_the_gallery():
    assert {kind for _, kind, *_ in DRAWN} == set(kinds())
    shown = set(re.findall(r"\]\(gallery/([\w.]+)\)", PAGE))
    assert shown == {f"{name}.png" for name, *_ in DRAWN} | {"blowup.gif"}
    there = {path.name for path in (TOP / "docs" / "gallery").iterdir()}
    assert there == shown and all((TOP / "docs" / "gallery" / name).stat().st_size < 500_000 for name in there)


COMMANDS = [
    shlex.split(line, comments=True)[1:] for line in [*PAGE.splitlines(), *SCRIPT.replace("\\\n", " ").splitlines()]
    if line.strip().startswith("tcbench ") and '"$@"' not in line
]  # fmt: skip


@pytest.mark.parametrize("words", [*COMMANDS, *(["plot", kind, *rest] for _, kind, *rest in DRAWN)], ids=" ".join)
def test_every_command_of_the_gallery_is_understood(words):
    words = [word.replace('"', "") for word in words]
    command = cli.main.commands[words[0]]
    assert command.make_context(words[0], words[1:])
