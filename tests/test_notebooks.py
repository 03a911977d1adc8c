"""The notebooks of the documentation: they run, and print what they show."""

import ast
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


@pytest.mark.thorough
@pytest.mark.parametrize("path", BOOKS, ids=lambda p: p.stem)
def test_it_runs_and_prints_what_it_shows(path, tmp_path, monkeypatch, capsys):
    """In an empty folder, as a plain program; numbers may differ in digits of round-off, words may not, of values
    at the end of a cell neither: a list of scenarios had 8 of the 14."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = {"__name__": "notebook"}
    for number, cell in enumerate(cells(path, "code"), start=1):
        capsys.readouterr()
        *rest, last = ast.parse("".join(cell["source"])).body
        value = isinstance(last, ast.Expr)
        exec(compile(ast.Module(rest if value else [*rest, last], []), f"{path.name}, cell {number}", "exec"), names)
        result = eval(compile(ast.Expression(last.value), path.name, "eval"), names) if value else None
        texts = [
            o.get("text") or o["data"]["text/plain"] for o in cell["outputs"] if o["output_type"] != "display_data"
        ]
        found = capsys.readouterr().out + (repr(result) if texts and result is not None else "")
        assert words(found) == words("".join(map("".join, texts))), f"cell {number}"


def words(text):
    return re.sub(r"\d[\d.e+-]*", "#", text).split()
