"""The plugin files of a run, kept in its folder: a colleague who gets the folder sees what was measured."""

from __future__ import annotations

import hashlib
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..errors import writing
from ..files import replacing
from ..inputs import marks

if TYPE_CHECKING:
    from ..store.store import Store
    from .planning import Job

FOLDER = "sources"


def measured_files(job: Job, store: Store) -> dict[str, bytes]:
    """Relative name -> content of the Python files in plugins' folders that were read when the cells were measured.

    What an installed distribution brought is known by its version; a file that has been edited since is left out. Two
    files of one name are told apart by a part of their hash.
    """
    anchors, rows = job.context["anchors"], store.rows()
    noted = {str(rows[cell.key].get("inputs") or "") for cell in job.cells if cell.key in rows} - {""}
    read = {item for name in noted for item in (store.inputs(name) or {"files": {}})["files"].items()}
    found: dict[str, bytes] = {}
    for path, mark in sorted(item for item in read if item[1]):
        relative = path.partition(">/")[2]
        if not path.endswith(".py") or not relative or ".." in PurePosixPath(relative).parts or path.startswith("<>"):
            continue
        place = Path(marks.placed(path, anchors))
        text = place.read_bytes() if place.is_file() else b""
        if marks.text_hash(text) == mark:
            text = text.replace(b"\r\n", b"\n")
            name = Path(relative)
            found[relative if found.get(relative, text) == text else _marked(name, text).as_posix()] = text
    return found


def keep(job: Job, store: Store) -> list[Path]:
    """Write them into the run's folder; returns their paths.

    A file of an earlier run that has been edited since stays beside the current one, part of its hash in its name.
    """
    written = []
    for name, text in measured_files(job, store).items():
        path = store.folder / FOLDER / name
        with writing(repr(str(path))):
            if path.is_file() and (earlier := path.read_bytes()) != text:
                path.replace(_marked(path, earlier))
                _marked(path, text).unlink(missing_ok=True)  # an edit that was undone
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as temporary:
                temporary.write_bytes(text)
        written.append(path)
    return written


def _marked(path: Path, text: bytes) -> Path:
    return path.with_name(f"{path.stem}-{hashlib.sha256(text).hexdigest()[:8]}{path.suffix}")
