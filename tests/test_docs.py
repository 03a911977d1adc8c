"""The pages of the site: every command and snippet is run, in order, in an empty folder; and the site builds."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from click.testing import CliRunner

from tcbench import plugins
from tcbench.cli import main

ROOT = Path(__file__).parent.parent
PAGES = (
    "index",
    "add-integrator",
    "add-scenario",
    "add-system",
    "solids",
    "add-study",
    "measures",
    "physics",
    "chain",
    "cite",
    "peers",
)
BLOCK = re.compile(r'(<!-- not run: [^\n]*-->\n)?```(sh|python)(?: title="([\w.]+)")?\n(.*?)```', re.DOTALL)


def blocks(page):
    """(language, file to write or "", text) of each block that is to be run."""
    text = (ROOT / "docs" / f"{page}.md").read_text()
    return [(language, name, code) for skipped, language, name, code in BLOCK.findall(text) if not skipped]


def test_the_page_of_commands_is_what_they_say():
    """Two studies were missing from it."""
    from importlib.util import module_from_spec, spec_from_file_location

    spec = spec_from_file_location("command_line", ROOT / "docs" / "command_line.py")
    spec.loader.exec_module(module := module_from_spec(spec))
    assert module.PAGE.read_text("utf-8") == module.page(), "python docs/command_line.py"


@pytest.fixture
def empty(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", ["index", *(pytest.param(p, marks=pytest.mark.thorough) for p in PAGES[1:])])
def test_every_command_and_snippet_of_a_page_runs(page, empty, request):
    if page == "index":  # of the first tier; the others run as a reader's do
        request.getfixturevalue("cells_here")
    ran = 0
    for language, name, code in blocks(page):
        if name:
            (empty / name).write_text(code)
            continue
        if language == "python":
            exec(compile(code, f"{page}.md", "exec"), {"__name__": "snippet"})
            ran += 1
            continue
        for line in code.splitlines():
            words = line.partition("#")[0].split()
            if words:
                plugins.forget()  # every command is a process of its own for the reader
                assert words[0] == "tcbench", f"{page}.md has a command that is not run: {line}"
                done = CliRunner().invoke(main, words[1:])
                assert done.exit_code == 0, f"{page}.md: {line}\n{done.output}\n{done.exception}"
                ran += 1
    assert ran >= 1


@pytest.mark.thorough
def test_what_the_pages_promise_is_there_afterwards(empty):
    """The reader's own methods are in the table."""
    import csv

    for _, name, code in blocks("add-integrator"):
        if name in ("avf.py", "explicit_midpoint.py"):
            (empty / name).write_text(code)
    args = ["-s", "bound_equilibrium", "--study", "conservation", "--dt", "0.05", "--plugins-dir", ".", "-o", "out"]
    done = CliRunner().invoke(main, ["run", "-i", "avf", "-i", "explicit_midpoint", *args])
    rows = list(csv.DictReader((empty / "out" / "tables" / "conservation.csv").open()))
    assert done.exit_code == 0 and {row["integrator"] for row in rows} == {"avf", "explicit_midpoint"}


def test_every_page_is_in_the_navigation_and_every_link_leads_somewhere():
    site = (ROOT / "mkdocs.yml").read_text()
    for page in PAGES:
        assert f": {page}.md" in site
        text = (ROOT / "docs" / f"{page}.md").read_text()
        for target in re.findall(r"\]\(([^)#]+)", text):
            assert target.startswith("http") or (ROOT / "docs" / target).exists(), f"{page}.md: {target}"
        for target in re.findall(r"(?:benchmarks|plugins|tcbench|tests)/[\w/]+\.py", text):
            assert (ROOT / target).is_file(), f"{page}.md: {target}"


@pytest.mark.thorough
@pytest.mark.skipif(not (find_spec("mkdocs") and find_spec("mkdocstrings")), reason="the extra docs is not installed")
def test_the_site_builds_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr
    assert "tc_monolithic" in (tmp_path / "site" / "example" / "report.html").read_text()
    page, reference = (tmp_path / "site" / "api" / "index.html").read_text(), (ROOT / "docs" / "api.md").read_text()
    named = re.findall(r"^::: (\S+)$", reference, re.MULTILINE)
    assert len(named) > 20 and not [name for name in named if f'id="{name}"' not in page]
