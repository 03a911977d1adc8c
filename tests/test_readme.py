"""The README's commands and snippets, run as a reader would: in an empty folder, in the order of the page."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from command import tcbench

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


def test_the_readme_links_to_files_that_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
