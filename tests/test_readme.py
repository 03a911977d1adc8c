"""The README's commands and snippets, run as a reader would: in an empty folder, in the order of the page."""

import re
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text()
BLOCKS = re.findall(r"```(sh|python)\n(.*?)```", README, re.DOTALL)


def test_every_snippet_of_the_readme_runs(tmp_path):
    tcbench = [sys.executable, "-m", "tcbench"]
    ran = 0
    for language, text in BLOCKS:
        if language == "python":
            name = "mine.py" if "hookimpl" in text else "snippet.py"
            (tmp_path / name).write_text(text)
            commands = [[sys.executable, name]]
        else:
            lines = [line.partition("#")[0].split() for line in text.splitlines()]
            commands = [tcbench + words[1:] for words in lines if words and words[0] == "tcbench"]
        for command in commands:
            done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
            assert done.returncode == 0, f"{command}: {done.stderr}"
            ran += 1
    assert ran >= 7
    assert (tmp_path / "run.csv").exists() and (tmp_path / "results/mine/tables/conservation.csv").exists()


def test_the_readme_links_to_files_that_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (Path(__file__).parent.parent / target).exists(), target
