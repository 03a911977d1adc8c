"""Folders, files and names that somebody else made: nothing is followed, run, overwritten or waited for."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import awkward
import pytest
from click.testing import CliRunner
from command import tcbench

from tcbench.cli import main
from tcbench.errors import TcbenchError, visible
from tcbench.report.html import script_hash
from tcbench.report.publish import publish
from tcbench.report.write_report import write_report
from tcbench.runner.compare import compare, other_machine
from tcbench.runner.rows import Store
from tcbench.runner.tables import read_tables

BASELINE = Path(__file__).resolve().parents[1] / "results" / "baseline"


@pytest.fixture
def folder(tmp_path):
    tables = {"conservation": awkward.conservation(["tc_monolithic"], ["short_term"])}
    return awkward.write_run(tmp_path / "run", tables, (), awkward.declared(["tc_monolithic"], ["short_term"]))


def test_no_link_is_followed_for_the_lock(tmp_path):
    (tmp_path / "precious").write_text("data")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".lock").symlink_to(tmp_path / "precious")
    with pytest.raises(TcbenchError, match="Cannot write to the run folder"):
        Store.open(tmp_path / "run")
    assert (tmp_path / "precious").read_text() == "data"


def test_what_is_published_is_of_the_run_and_written_by_tcbench(folder, tmp_path):
    secret = tmp_path / "secret.py"
    secret.write_text("password = 1")
    (folder / "report.html").write_text("<script>alert(1)</script>")
    (folder / "tables" / "link.csv").symlink_to(secret)
    (folder / "tables" / "evil.svg").write_text("<svg/>")
    os.utime(folder / "report.html", (2**31, 2**31))
    publish([folder], tmp_path / "site")
    place = tmp_path / "site" / "run"
    assert {p.suffix for p in (place / "tables").iterdir()} <= {".csv", ".parquet"}
    assert (place / "tables" / "conservation.csv").exists() and not (place / "tables" / "link.csv").exists()
    assert "alert(1)" not in (place / "index.html").read_text("utf-8")
    shutil.rmtree(folder / "tables")
    (folder / "tables").symlink_to(BASELINE / "tables")
    publish([folder], tmp_path / "site")
    assert list((place / "tables").iterdir()) == []


def test_a_page_runs_its_own_scripts_and_no_others(folder):
    text = write_report(folder).read_text("utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert "script-src 'sha256-" in policy and "base-uri 'none'" in policy
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    styles = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    assert len(scripts) == 1 and script_hash(scripts[0]) in policy and "unsafe" not in policy
    assert len(styles) == 1 and script_hash(styles[0]) in policy and policy.count("sha256") == 3  # and the library's
    assert not re.search(r"<[^>]+ on[a-z]+=", text.partition("<script")[0])


def test_names_do_not_steer_the_terminal(tmp_path):
    assert visible("a\x1b[2J\x07\x9b\u202eb\tc") == "a\\x1b[2J\\x07\\x9b\\u202eb\tc"
    name = tmp_path / "r\x1b]0;evil\x07"
    done = tcbench("show", str(name))
    assert done.returncode == 2 and "\x1b" not in done.stderr and "evil" in done.stderr
    shutil.copytree(BASELINE, name)
    table = name / "tables" / "stability.csv"
    table.write_text(table.read_text().replace("tc_strang", "\x1b[31mtc\x1b[0m"))
    shown = tcbench("show", str(name), "--table", "stability")
    assert shown.returncode == 0 and "\x1b" not in shown.stdout + shown.stderr and "\\x1b[31mtc" in shown.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="of Linux")
@pytest.mark.parametrize("end", [">/dev/full", ">&-"])
def test_output_that_cannot_be_written_is_a_sentence(end):
    done = subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -m tcbench cache {end}'], capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr and "Exception ignored" not in done.stderr
    assert (done.returncode, done.stderr.count("\n")) == ((2, 1) if "full" in end else (0, 0))


@pytest.mark.parametrize("words", [["show", "\0"], ["run", "-i", "tc_gauss", "-o", "a\0b", "--dry-run"]])
def test_a_null_byte_is_a_sentence(words):
    done = CliRunner().invoke(main, words)
    assert (done.exit_code, done.stderr) == (2, "Error: a name has a null byte in it, which no file can have.\n")


def test_a_damaged_provenance_is_an_unknown_machine(tmp_path):
    shutil.copytree(BASELINE, folder := tmp_path / "run")
    (folder / "provenance").mkdir()
    (folder / "provenance" / "x.json").write_text(json.dumps({"machine": "x"}))
    assert "different machines" in other_machine(folder, BASELINE) and compare(folder, BASELINE).empty


def test_parts_of_a_folder_that_are_not_what_tcbench_writes_are_left_out_with_a_sentence(tmp_path):
    """They were tracebacks: claims that are a number, a git state that is one, a table without status."""
    tables = {"stability": awkward.stability(["tc_monolithic"], ["short_term"])}
    folder = awkward.write_run(tmp_path / "run", tables, (), awkward.declared(["tc_monolithic"], ["short_term"]))
    (folder / "tables" / "conservation.csv").write_text("integrator,scenario,dt\na,b,0.1\n")
    for value in (5, None, {"a": 5}, 10**400):
        for name, key in (("declared.json", "integrators"), ("manifest.json", "git")):
            data = json.loads((folder / name).read_text())
            data |= {key: value if key == "git" else {"tc_monolithic": data[key]["tc_monolithic"] | {"claims": value}}}
            (folder / name).write_text(json.dumps(data))
        store = Store.read(folder)
        assert "claims" not in store.declared().get("integrators", {}).get("tc_monolithic", {}), value
        store.manifest()
        assert "declared.json" in " ".join(store.problems)
        if value == 5:
            assert write_report(folder).exists()
    assert "conservation" not in read_tables(store) and "has no column status" in " ".join(store.problems)
