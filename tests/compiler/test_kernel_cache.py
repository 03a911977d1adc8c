"""The compile cache: kernels are reused across processes, and an edit of a helper changes the answer."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tcbench.compiler.values import constant

PACKAGE = Path(__file__).parents[2]
PRINT = (
    "import tcbench; from tcbench.compiler import special; "
    "run = tcbench.simulate('tc_monolithic', 'short_term', t_end=0.3); "
    "print(special.phi(0.1), run.energy[-1])"
)


def run(code, folder, cache):
    """Run code with a copy of the sources first on the path."""
    env = os.environ | {"PYTHONPATH": str(folder), "TCBENCH_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-P", "-c", code], env=env, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.thorough
def test_editing_a_helper_changes_the_answer_and_not_editing_it_reuses_the_cache(tmp_path):
    for name, copy in (("tcbench", "tcbench"), ("plugins", "tcbench_plugins")):  # with byte code, that others may write
        shutil.copytree(PACKAGE / name, tmp_path / "copy" / copy, ignore=shutil.ignore_patterns("*.pyc.*"))
    cache = tmp_path / "cache"
    first = run(PRINT, tmp_path / "copy", cache)
    compiled = {p: p.stat().st_mtime_ns for p in cache.rglob("*.o")}
    assert len(compiled) > 10 and {p.parent for p in compiled} == {cache / "code"}
    assert run(PRINT, tmp_path / "copy", cache) == first
    again = {p: p.stat().st_mtime_ns for p in cache.rglob("*.o")}
    assert again == compiled  # nothing was compiled again

    helper = tmp_path / "copy" / "tcbench" / "compiler" / "special.py"
    helper.write_text(helper.read_text().replace("1.0 + x *", "1.001 + x *"))
    edited = run(PRINT, tmp_path / "copy", cache)
    assert abs(float(edited[0]) - float(first[0]) - 0.001) < 1e-9
    assert edited[1] != first[1]  # the kernels, which call the helper from other files, noticed
    helper.write_text(helper.read_text().replace("1.001 + x *", "1.0 + x *"))
    before = set(cache.rglob("*.o"))
    assert run(PRINT, tmp_path / "copy", cache) == first and set(cache.rglob("*.o")) == before


LIBRARY = """from __future__ import annotations
from tcbench.compiler.library import Library
{3}
def {0}({1}: float) -> float:
    return {2}
LOOPS = Library("loops", {0})
"""
HELPER = "from __future__ import annotations\nLIMIT = {limit}\ndef scale(x: float) -> float:\n    return x * {factor}\n"
WAYS = {  # module: name, argument and text of its function, and what it imports
    "one": ("march", "x", "x + 1.0", ""),
    "two": ("march", "x", "x * 100.0", ""),  # the same names in the same folder
    "three": ("step", "x", "x + 1.0", ""),  # another name for the first one's text
    "four": ("exp", "place", "place + 2.0", ""),  # names that C and the caller have, too
    "five": ("f", "x", "other.scale(x) + other.LIMIT", "import other"),
    "six": ("f", "x", "scale(x) + LIMIT", "from other import LIMIT, scale"),
}
CALL = """import importlib, sys; sys.path[:0] = {folders!r}
for name in {names!r}:
    module = importlib.import_module(name)
    function = module.LOOPS.functions[0]
    assert getattr(module.LOOPS, function.__name__)(5.0) == function(5.0), name
    print(function(5.0))
"""


def test_names_folders_and_helpers_of_libraries_cannot_matter(tmp_path):
    """Each gave another one's number, or called address 0, while its file was named after names and a folder's hash."""
    mine, others, cache = tmp_path / "mine", tmp_path / "others", tmp_path / "cache"
    for folder in (mine, others):
        folder.mkdir()
    for name, parts in WAYS.items():
        (mine / f"{name}.py").write_text(LIBRARY.format(*parts))
    code = CALL.format(folders=[str(mine), str(others)], names=list(WAYS))
    for limit, factor in ((3.0, 2.0), (4.0, 5.0)):
        (others / "other.py").write_text(HELPER.format(limit=limit, factor=factor))
        found = [float(x) for x in run(code, tmp_path, cache)]
        assert found == [6.0, 500.0, 6.0, 7.0, 5 * factor + limit, 5 * factor + limit]
    assert len(list(cache.rglob("*.o"))) == 6  # five, as two modules give the same code, and one more by the edit


EDITED = """import pathlib, sys; sys.path.insert(0, {folder!r})
first, second = (pathlib.Path({folder!r}, name) for name in ("first.py", "second.py"))
import first as one, second as two
one.LOOPS.f(1.0)
second.write_text(second.read_text().replace("1.0", "1000.0"))  # the author saves an edit while the process runs
print(two.LOOPS.f(1.0))
second.write_text(second.read_text().replace("1000.0", "1.0"))
"""


def test_a_file_that_is_edited_while_a_process_runs_spoils_nothing(tmp_path):
    for name, text in (("first", "x + 0.0"), ("second", "x + 1.0")):
        (tmp_path / f"{name}.py").write_text(LIBRARY.format("f", "x", text, ""))
    assert run(EDITED.format(folder=str(tmp_path)), tmp_path, tmp_path / "cache") == ["2.0"]
    again = CALL.format(folders=[str(tmp_path)], names=["first", "second"])
    assert run(again, tmp_path, tmp_path / "cache") == ["5.0", "6.0"]


def test_zeros_of_both_signs_are_two_constants():
    assert constant(0.0) != constant(-0.0) and constant(0.0) == constant(0.0)
