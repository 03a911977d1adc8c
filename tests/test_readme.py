"""The README's commands and snippets, run as a reader would: in an empty folder, in the order of the page."""

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from command import tcbench

from tcbench.commands.terminal import number
from tcbench.studies.columns import column
from tcbench.studies.conservation import CONSERVATION

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```(sh|python)\n(.*?)```", README, re.DOTALL)


@pytest.mark.thorough
def test_every_snippet_of_the_readme_runs(tmp_path):
    ran = 0
    for language, text in BLOCKS:
        if language == "python":
            name = "mine.py" if "hookimpl" in text else "snippet.py"
            (tmp_path / name).write_text(text)
            done = subprocess.run([sys.executable, name], cwd=tmp_path, capture_output=True, text=True)
            assert done.returncode == 0, f"{name}: {done.stderr}"
            ran += 1
            continue
        lines = [line.partition("#")[0].split() for line in text.splitlines()]
        for words in (words for words in lines if words and words[0] == "tcbench"):
            done = tcbench(*words[1:], cwd=tmp_path)
            assert done.returncode == 0, f"{words}: {done.stderr}"
            ran += 1
    assert ran >= 7
    assert (tmp_path / "run.csv").exists() and (tmp_path / "results/mine/tables/conservation.csv").exists()


def test_the_readmes_result_is_the_baselines():
    table = pd.read_csv(ROOT / "results" / "baseline" / "tables" / "conservation.csv")
    rows = table[(table.scenario == "stiff_spring") & (table.dt == 0.3)].set_index("integrator")
    block = README.split("$ tcbench run -s stiff_spring")[1].split("```")[0].splitlines()
    names = {column(name).short: name for name in CONSERVATION.terminal}
    start = next(i for i, line in enumerate(block) if line.startswith("integrator"))
    headings = re.split(r"  +", block[start].strip())
    shown = [dict(zip(headings, line.split(), strict=True)) for line in block[start + 1 :] if line]
    assert len(shown) == len(rows) == 5
    for row in shown:
        expected = rows.loc[row.pop("integrator")]
        assert row == {heading: number(expected[names[heading]]) for heading in row}


def test_the_readme_links_to_files_that_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
