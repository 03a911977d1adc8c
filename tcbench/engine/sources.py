"""The plugin files of a run, kept in its folder: a colleague who gets the folder sees what was measured."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from .. import plugins
from ..errors import TcbenchError
from ..files import replacing
from .fingerprint import local_files

if TYPE_CHECKING:
    from .planning import Job

FOLDER = "sources"


def plugin_files(job: Job) -> dict[str, bytes]:
    """Relative name -> content of the files that brought methods and scenarios, with the local modules they import.

    Files only: what an installed distribution brought is known by its name and version. Two files of one name are told
    apart by a part of their hash.
    """
    registry = plugins.registry()
    used = {name for method in job.methods for name in (method.plugin, *method.uses)}
    used |= {scenario.plugin for scenario in job.scenarios} | {metric.plugin for metric in registry.metrics.values()}
    origins = [registry.origins[name] for name in sorted(used & set(registry.origins))]
    found: dict[str, bytes] = {}
    seen: set[Path] = set()
    for origin in origins:
        if origin.path and not origin.distribution:
            for name, text in local_files(Path(origin.path).resolve(), seen):
                path = Path(name)
                found[name if found.get(name, text) == text else _marked(path, text).as_posix()] = text
    return found


def keep(job: Job, output: Path) -> list[Path]:
    """Write them into the run's folder; returns their paths.

    A file of an earlier run that has been edited since stays beside the current one, part of its hash in its name.
    """
    written = []
    for name, text in plugin_files(job).items():
        path = output / FOLDER / name
        try:
            if path.is_file() and (earlier := path.read_bytes()) != text:
                path.replace(_marked(path, earlier))
                _marked(path, text).unlink(missing_ok=True)  # an edit that was undone
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as temporary:
                temporary.write_bytes(text)
        except OSError as error:
            raise TcbenchError(f"{str(path)!r} cannot be written: {error.strerror}.") from None
        written.append(path)
    return written


def _marked(path: Path, text: bytes) -> Path:
    return path.with_name(f"{path.stem}-{hashlib.sha256(text).hexdigest()[:8]}{path.suffix}")
