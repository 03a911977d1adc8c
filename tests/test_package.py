"""What is handed out: the metadata say what is true. What is built is looked at by .ci/package.py."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_the_licence_expression_covers_what_the_page_embeds():
    vendor = ROOT / "tcbench" / "report" / "templates" / "vendor"
    text = (vendor / "LICENSES.txt").read_text()
    for path in vendor.iterdir():
        assert path.name == "LICENSES.txt" or path.name in text, f"{path.name} has no licence in LICENSES.txt"
    named = {"MIT": "MIT", "ISC": "ISC", "Apache": "Apache-2.0", "BSD": "BSD-3-Clause"}
    for word, licence in named.items():
        if re.search(rf"\b{word}\b", text):
            assert licence in PROJECT["project"]["license"], f"{licence} is missing in the licence expression"


def test_a_copy_without_git_has_a_version(tmp_path):
    pytest.importorskip("setuptools_scm")
    shutil.copyfile(ROOT / "pyproject.toml", tmp_path / "pyproject.toml")
    code = "import setuptools_scm as s; print(s._get_version(s.Configuration.from_file('pyproject.toml')))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == PROJECT["tool"]["setuptools_scm"]["fallback_version"]
