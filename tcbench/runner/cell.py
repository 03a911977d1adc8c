"""The unit of work, of failure and of reuse: a cell; and `made_by`, the one rule of reuse.

A row is used again if tcbench, its packages, and the folder (or distribution) of its plugin are as they were. Nothing
watches what a plugin reads: files outside its folder are named in `uses=[...]`, or the run is told `--fresh`.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from .codec import canonical_json, plain
from .provenance import NUMERICAL_PACKAGES, versions

if TYPE_CHECKING:
    from ..integrator import Integrator
    from ..study import Study
    from ..systems.scenario import Scenario

KEPT = ("sweep",)  # options that decide what a row keeps, and nothing that it measures
SUFFIXES = frozenset({
    ".py", ".pyi", ".so", ".pyd", ".dll", ".dylib", ".json", ".toml", ".csv", ".txt", ".dat", ".npy", ".npz", ".h5",
    ".pt", ".onnx",
})  # fmt: skip
SKIPPED = frozenset({"__pycache__", "site-packages", "node_modules"})
RUN_FILES = ("cells.jsonl", "pyvenv.cfg")  # of folders inside a plugin's that are none of it: runs, environments
LARGE = 2**24  # bytes of a data file, of which size and time count instead of the content
NO_NUMBERS = frozenset({"authoring", "cli.py", "commands", "progress.py", "report", "__main__.py"})  # of tcbench
TOLD = ("TCBENCH_PLAIN", "TCBENCH_TARGET")  # variables that change digits


@dataclass(frozen=True)
class Cell:
    """One measurement to make: a study, an integrator, a scenario and the study's options (JSON values).

    timed : the row holds a timing: the cell runs alone on the machine, after all the others.
    """

    study: str
    integrator: str
    scenario: str
    options: Mapping[str, Any] = field(default_factory=dict)
    timed: bool = False

    def __post_init__(self) -> None:
        try:
            options = json.loads(json.dumps(dict(self.options), default=plain, sort_keys=True))
        except (TypeError, ValueError) as error:
            raise TcbenchError(
                f"The options of a cell of study {self.study!r} ({self.integrator}, {self.scenario}) are not JSON: "
                f"{error}. Use numbers, strings, lists and dicts with string keys."
            ) from error
        object.__setattr__(self, "options", options)

    @cached_property
    def key(self) -> str:
        """Sha256 of all fields: of two rows of one key the last counts."""
        return digest(self.as_dict())

    def as_dict(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __hash__(self) -> int:
        return hash(self.key)


def identity_of(cell: Mapping[str, Any]) -> str:
    """What a cell measures, whatever its row keeps."""
    return canonical_json({**cell, "options": {k: v for k, v in cell.get("options", {}).items() if k not in KEPT}})


def digest(value: Any) -> str:
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


# -- what a row was made by


def made_by(method: Integrator, scenario: Scenario, study: Study | None = None, system: str = "") -> str:
    """What the row of a cell depends on beside the cell, as "TCBENCH-METHOD-SCENARIO", three hashes: of tcbench and
    the packages under it; of the plugins that bring the method (and the study), the packages that it requires and the
    files that it `uses`; of the scenario's data and its plugin.

    system : folder of the code of a scenario that no plugin brings.
    """
    from .. import plugins

    own = (method.name, method.plugin, *((study.plugin,) if study else ()))
    metrics = [m.plugin for m in plugins.metrics().values()] if study and study.metrics else []
    parts = [_marks(plugins.needs(*own, *metrics)), method.versions(), method.order, [*_files(method)], sorted(metrics)]
    of_scenario = [
        _marks(plugins.needs(scenario.name, scenario.plugin)),
        scenario.data(),
        system and folder_mark(system),
    ]
    return f"{tcbench_mark()}-{digest(parts)[:12]}-{digest(of_scenario)[:12]}"


def forget() -> None:
    """Look at every file again."""
    for known in (tcbench_mark, folder_mark, plugin_mark):
        known.cache_clear()


def _marks(labels: Iterable[str]) -> list[str]:
    return sorted(plugin_mark(label) for label in labels)


@cache
def tcbench_mark() -> str:
    """tcbench, its own plugins, the packages under them, Python."""
    found: dict[str, Any] = {"python": list(sys.version_info[:2]), "packages": versions(NUMERICAL_PACKAGES)}
    found |= {"cpu": platform.machine(), "told": {name: os.environ[name] for name in TOLD if name in os.environ}}
    for name in ("tcbench", "tcbench_plugins"):
        folder = Path(sys.modules[name].__file__ or "").parent if name in sys.modules else None
        found[name] = folder and folder_mark(str(folder), NO_NUMBERS)
    return digest(found)[:12]


@cache
def plugin_mark(label: str) -> str:
    """A plugin's folder; of one that is installed the version, and the hashes that were written when it was."""
    from .. import plugins

    origin = plugins.registry().origins[label]
    if origin.distribution and origin.path.startswith(tuple(sysconfig.get_path(p) for p in ("purelib", "platlib"))):
        try:
            record = distribution(origin.distribution).read_text("RECORD") or ""
        except PackageNotFoundError:
            record = ""
        return f"{origin.distribution} {origin.version} {digest([r for r in record.splitlines() if '/bin/' not in r])}"
    return folder_mark(str(plugin_folder(label)))


def plugin_folder(label: str) -> Path:
    """Where a plugin's code lies: beside its file, or its whole package."""
    from .. import plugins

    origin = plugins.registry().origins[label]
    folder = Path(origin.path).parent
    while origin.distribution and (folder.parent / "__init__.py").exists():
        folder = folder.parent
    return folder


@cache
def folder_mark(folder: str, without: frozenset[str] = frozenset()) -> str:
    """Names and contents of the code and data in a folder; without the runs and environments that lie in it."""
    found = hashlib.sha256()
    for path in _inside(Path(folder), without):
        found.update(f"{path.relative_to(folder).as_posix()}\0{content_mark(path)}\0".encode())
    return found.hexdigest()[:16]


def _inside(folder: Path, without: frozenset[str] = frozenset()) -> Iterator[Path]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    names = {entry.name for entry in entries}
    for entry in entries:
        if entry.name.startswith(".") or entry.name in SKIPPED or entry.name in without:
            continue
        path = Path(entry.path)
        if entry.is_dir(follow_symlinks=False):
            if not any((path / name).exists() for name in RUN_FILES):
                yield from _inside(path)
        elif path.suffix in SUFFIXES and entry.is_file() and not (path.suffix != ".py" and "cells.jsonl" in names):
            yield path


def content_mark(path: Path) -> str:
    """Of a file's content, of Python with the line ends of Unix."""
    try:
        state = path.stat()
        if state.st_size > LARGE:
            return f"{state.st_size} {state.st_mtime_ns}"
        data = path.read_bytes()
    except OSError as error:
        return type(error).__name__
    return hashlib.sha256(data.replace(b"\r\n", b"\n") if path.suffix == ".py" else data).hexdigest()


def _files(method: Integrator) -> Iterator[tuple[str, str]]:
    """What `uses` names beside methods and plugins: files and folders, by their path from the plugin's own."""
    from .. import plugins

    registry = plugins.registry()
    known = registry.origins.keys() | registry.integrators.keys()
    for name in method.uses:
        if name not in known and "[" not in name and method.plugin in registry.origins:
            path = Path(registry.origins[method.plugin].path).parent / name
            if path.exists():
                yield name, folder_mark(str(path)) if path.is_dir() else content_mark(path)
