"""`publish`: a static site of several runs, an index by machine with each run's report and tables; for any web host."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from ..errors import TcbenchError, writing
from ..files import replacing
from ..runner.rows import Store
from .together import machine
from .write_report import templates, write_report

COPIED = (".csv", ".parquet")  # of a run's tables; nothing that a browser would run
INDEX, TOGETHER = "index.html", "together.html"


def publish(folders: Sequence[str | Path], output: str | Path) -> Path:
    """Write the site; returns the path of its index. A folder that is published again takes its own place.

    folders : run folders, whose pages are written anew. Folders of one name are numbered. Links are not followed.
    output : folder of the site, made where it does not exist; what else is in it stays.
    Raises TcbenchError for folders that hold no run, and where the site cannot be written.
    """
    output = Path(output)
    runs = [_checked(Path(folder), output) for folder in folders]
    if not runs:
        raise TcbenchError("tcbench publish takes at least one run folder.")
    names: dict[str, int] = {}
    entries = []
    with writing(f"The site in {str(output)!r}"):
        for run in runs:
            name = run.resolve().name
            names[name] = names.get(name, 0) + 1
            entries.append(_published(run, name if names[name] == 1 else f"{name}-{names[name]}", output))
        if len(runs) > 1:
            write_report(runs[0], page=output / TOGETHER, others=runs[1:])
        entries.sort(key=itemgetter("machine", "ended", "name"))
        page = templates().get_template("site.html").render(entries=entries)
        with replacing(output / INDEX) as temporary:
            temporary.write_text(page, encoding="utf-8")
    return output / INDEX


def _checked(folder: Path, output: Path) -> Path:
    if not folder.is_dir() or not (folder / "manifest.json").is_file():
        raise TcbenchError(f"There is no run in {str(folder)!r}. tcbench run --output FOLDER makes one.")
    if Path(os.path.realpath(output)).is_relative_to(os.path.realpath(folder)):
        raise TcbenchError(f"The site {str(output)!r} would lie in the run {str(folder)!r}; choose another folder.")
    return folder


def _published(run: Path, name: str, output: Path) -> dict[str, Any]:
    """Copy what is shown of one run; what the index says of it, its folder by name."""
    store = Store.read(run)
    manifest, declared = store.manifest(), store.declared()
    place = output / name
    place.mkdir(parents=True, exist_ok=True)
    write_report(run, page=place / INDEX)  # anew: whose scripts the page in the folder has nobody knows
    shutil.rmtree(place / "tables", ignore_errors=True)
    (place / "tables").mkdir()
    for file in (run / "tables").glob("[!.]*") if not (run / "tables").is_symlink() else ():
        if file.suffix.lower() in COPIED and file.is_file() and not file.is_symlink():  # which may lead out of it
            shutil.copyfile(file, place / "tables" / file.name)
    (place / "declared.json").write_text(json.dumps(declared, indent=2, sort_keys=True), encoding="utf-8")
    (place / "manifest.json").write_text(json.dumps(manifest, indent=2, sort_keys=True), encoding="utf-8")
    git: dict[str, Any] = manifest.get("git") or {}
    return {
        "name": name, "ended": str(manifest.get("ended", "")), "version": manifest.get("tcbench", ""),
        "machine": machine(manifest, "system") or "machine not known", "python": manifest.get("python", ""),
        "commit": str(git.get("commit") or "")[:10], "unfinished": manifest.get("interrupted"),
        "integrators": len(declared.get("integrators", {})), "scenarios": len(declared.get("scenarios", {})),
        "tables": sorted(p.stem for p in (place / "tables").glob("*.csv")),
    }  # fmt: skip
