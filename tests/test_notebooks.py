"""The notebooks of the documentation: executed as they stand, with outputs, small, and still running."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def cells(path, kind):
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


def test_there_are_five_and_the_page_leads_to_each():
    page = (ROOT / "docs" / "notebooks.md").read_text()
    assert {path.name for path in BOOKS} == set(re.findall(r"\(notebooks/([\w.]+)\)", page)) and len(BOOKS) == 5


@pytest.mark.parametrize("path", BOOKS, ids=lambda p: p.stem)
def test_it_is_executed_and_small(path):
    code = cells(path, "code")
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert outputs and not any(output["output_type"] == "error" for output in outputs)
    assert path.stat().st_size < 200_000
    assert "/root" not in path.read_text() and "/home" not in path.read_text()


@pytest.mark.thorough
@pytest.mark.parametrize("path", BOOKS, ids=lambda p: p.stem)
def test_it_runs_and_prints_what_it_shows(path, tmp_path, monkeypatch, capsys):
    """In an empty folder, as a plain program; numbers may differ in digits of round-off, words may not."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = {"__name__": "notebook"}
    for number, cell in enumerate(cells(path, "code"), start=1):
        capsys.readouterr()
        exec(compile("".join(cell["source"]), f"{path.name}, cell {number}", "exec"), names)
        shown = "".join("".join(o["text"]) for o in cell["outputs"] if o["output_type"] == "stream")
        assert words(capsys.readouterr().out) == words(shown), f"cell {number}"


def words(text):
    return re.sub(r"\d[\d.e+-]*", "#", text).split()
