"""`publish`: a static site of several runs, an index by machine with each run's report and tables; for any web host."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import TcbenchError
from ..files import replacing
from ..store.store import Store
from .write_report import write_report

COPIED = ("summary.csv", "declared.json")  # beside report, tables, sources and the manifest
TREES = ("tables", "sources")
INDEX = "index.html"


@dataclass(frozen=True)
class Entry:
    """One run on the site: its folder there, and what the index says of it."""

    name: str
    folder: str
    machine: str
    ended: str
    version: str
    python: str
    commit: str
    integrators: int
    scenarios: int
    tables: tuple[str, ...]
    sources: bool
    unfinished: bool


def publish(folders: Sequence[str | Path], output: str | Path) -> Path:
    """Write the site; returns the path of its index. A folder that is published again takes its own place.

    folders : run folders; a report that is missing or older than the rows is written. Folders of one name are numbered.
    output : folder of the site, made where it does not exist; what else is in it stays.
    Raises TcbenchError for folders that hold no run, and where the site cannot be written.
    """
    from jinja2 import Environment, PackageLoader

    output = Path(output)
    runs = [_checked(Path(folder), output) for folder in folders]
    if not runs:
        raise TcbenchError("tcbench publish takes at least one run folder.")
    names: dict[str, int] = {}
    entries = []
    try:
        for run in runs:
            name = run.resolve().name
            names[name] = names.get(name, 0) + 1
            entries.append(_published(run, name if names[name] == 1 else f"{name}-{names[name]}", output))
        entries.sort(key=lambda e: (e.machine, e.ended, e.name))
        templates = Environment(loader=PackageLoader("tcbench.report"), autoescape=True, trim_blocks=True)
        page = templates.get_template("site.html").render(entries=entries)
        with replacing(output / INDEX) as temporary:
            temporary.write_text(page, encoding="utf-8")
    except OSError as error:
        raise TcbenchError(f"The site in {str(output)!r} cannot be written: {error.strerror or error}.") from None
    return output / INDEX


def _checked(folder: Path, output: Path) -> Path:
    if not folder.is_dir() or not (folder / "manifest.json").is_file():
        raise TcbenchError(f"There is no run in {str(folder)!r}. tcbench run --output FOLDER makes one.")
    if output.resolve() == folder.resolve() or folder.resolve() in output.resolve().parents:
        raise TcbenchError(f"The site {str(output)!r} would lie in the run {str(folder)!r}; choose another folder.")
    return folder


def _published(run: Path, name: str, output: Path) -> Entry:
    """Copy what is shown of one run."""
    store = Store.read(run)
    manifest, declared = store.manifest(), store.declared()
    report, rows = run / "report.html", run / "cells.jsonl"
    if not report.is_file() or (rows.is_file() and rows.stat().st_mtime > report.stat().st_mtime):
        write_report(run)
    place = output / name
    for tree in TREES:
        shutil.rmtree(place / tree, ignore_errors=True)
        if (run / tree).is_dir():
            shutil.copytree(run / tree, place / tree, ignore=shutil.ignore_patterns(".*"))
    place.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(report, place / INDEX)
    for file in COPIED:
        if (run / file).is_file():
            shutil.copyfile(run / file, place / file)
    (place / "manifest.json").write_text(json.dumps(manifest, indent=2, sort_keys=True), encoding="utf-8")
    git: dict[str, Any] = manifest.get("git") or {}
    return Entry(
        name=name, folder=name, ended=str(manifest.get("ended", "")), version=str(manifest.get("tcbench", "")),
        machine=_machine(manifest.get("machine") or {}),
        python=str(manifest.get("python", "")), commit=str(git.get("commit") or "")[:10],
        integrators=len(declared.get("integrators", {})), scenarios=len(declared.get("scenarios", {})),
        tables=tuple(sorted(p.stem for p in (place / "tables").glob("*.csv"))), sources=(place / "sources").is_dir(),
        unfinished=bool(manifest.get("interrupted")),
    )  # fmt: skip


def _machine(facts: dict[str, Any]) -> str:
    words = [
        str(facts.get("cpu") or ""),
        f"{facts['cores']} cores" if "cores" in facts else "",
        str(facts.get("system") or ""),
    ]
    return ", ".join(filter(None, words)) or "machine not known"
