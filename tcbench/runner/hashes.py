"""`made_by`, the one rule of reuse.

A row is used again if tcbench, the packages under it, and the folder (or distribution) of its plugin are as they were.
Nothing watches what a plugin reads: files elsewhere are named in `uses=[...]`, or the run is told `--fresh`.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import plugins
from .codec import digest
from .provenance import NUMERICAL_PACKAGES, versions

if TYPE_CHECKING:
    from ..integrator import Integrator
    from ..study import Study
    from ..systems.scenario import Scenario

# what lies in a plugin's folder and computes nothing: what programs write there, and what is written about it
OUTPUT = frozenset(
    ".pyc .log .out .tmp .bak .swp .lock .png .pdf .svg .gif .mp4 .jpg .html .md .rst .ipynb .tex .o".split()  # noqa: SIM905
)
SKIPPED = frozenset({"__pycache__", "site-packages", "node_modules"})
ENVIRONMENT, RUN = "pyvenv.cfg", "cells.jsonl"  # files that tell that a folder is no part of a plugin
OF_A_RUN = re.compile(r"cells\..*jsonl|(manifest|declared)\.json|summary\.csv|tables|provenance")
MANY, LARGE = 2000, 2**24  # files of a folder, bytes of a file, beyond which size and time count, not the content
NO_NUMBERS = frozenset({"authoring", "cli.py", "commands", "progress.py", "report", "__main__.py"})  # of tcbench
VARIABLES = ("TCBENCH_PLAIN", "TCBENCH_TARGET")  # of the environment, which change digits


def made_by(method: Integrator, scenario: Scenario, study: Study, system: Mapping[str, Any] | None = None) -> str:
    """What the row of a cell depends on beside the cell, as "TCBENCH-METHOD-SCENARIO", three hashes: of tcbench and
    the packages under it; of the plugins that bring the method (and the study), the packages that it requires and the
    files that it `uses`; of the scenario's data and its plugin.

    system : of a scenario that no plugin brings (`plan.scenario_data`): the folder of its code, and its hash.
    """
    metrics = [m.plugin for m in plugins.metrics().values()] if study.metrics else []
    own = plugins.needs(method.name, method.plugin, study.plugin, *metrics)
    parts = [_marks(own), method.versions(), method.order, [*_files(method)], sorted(metrics)]
    of_scenario = [_marks(plugins.needs(scenario.name, scenario.plugin)), scenario.data()]
    of_scenario += [system["code"], folder_mark(system["folder"])] if system else []
    return f"{tcbench_mark()}-{digest(parts)[:12]}-{digest(of_scenario)[:12]}"


def forget() -> None:
    """Look at every file again."""
    for hashed in (tcbench_mark, folder_mark, plugin_mark):
        hashed.cache_clear()


def _marks(labels: Iterable[str]) -> list[str]:
    return sorted(plugin_mark(label) for label in labels)


@cache
def tcbench_mark() -> str:
    """tcbench, its own plugins, the packages under them, Python."""
    parts: dict[str, Any] = {"python": list(sys.version_info[:2]), "packages": versions(NUMERICAL_PACKAGES)}
    parts |= {"cpu": platform.machine(), "told": {name: os.environ[name] for name in VARIABLES if name in os.environ}}
    for name in ("tcbench", "tcbench_plugins"):
        folder = Path(sys.modules[name].__file__ or "").parent if name in sys.modules else None
        parts[name] = folder and folder_mark(str(folder), NO_NUMBERS)
    return digest(parts)[:12]


@cache
def plugin_mark(label: str) -> str:
    """A plugin's folder; of one that is installed its version, the hashes that were written when it was installed, and
    the versions of what it requires."""
    origin = plugins.registry().origins[label]
    if not (origin.distribution and is_installed(origin.path)):
        return folder_mark(str(plugin_folder(label)))
    try:
        installed = distribution(origin.distribution)
        record = [r for r in (installed.read_text("RECORD") or "").splitlines() if "/bin/" not in r]
        required = versions(re.split(r"[^\w.-]", text)[0] for text in installed.requires or [])
    except PackageNotFoundError:
        record, required = [], {}
    return f"{origin.distribution} {origin.version} {digest([record, required])}"


def is_installed(path: str) -> bool:
    """Does a file lie among the installed packages?"""
    return path.startswith(tuple(sysconfig.get_path(place) + os.sep for place in ("purelib", "platlib", "stdlib")))


def plugin_folder(label: str) -> Path:
    """Where a plugin's code lies: beside its file, or its whole package."""
    origin = plugins.registry().origins[label]
    folder = Path(origin.path).parent
    while origin.distribution and (folder.parent / "__init__.py").exists():
        folder = folder.parent
    return folder


@cache
def folder_mark(folder: str, without: frozenset[str] = frozenset()) -> str:
    """Names and contents of what a folder has; without the runs, environments and pictures that lie in it."""
    sha, paths = hashlib.sha256(), [*_inside(Path(folder), without)]
    for path in paths:
        sha.update(f"{path.relative_to(folder).as_posix()}\0{_file_mark(path, len(paths) > MANY)}\0".encode())
    return sha.hexdigest()[:16]


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
        if RUN in names and OF_A_RUN.fullmatch(entry.name):  # the run is written into the plugin's own folder
            continue
        if entry.is_dir(follow_symlinks=False):
            if not any((path / name).exists() for name in (RUN, ENVIRONMENT)):
                yield from _inside(path)
        elif path.suffix not in OUTPUT and entry.is_file():
            yield path


def _file_mark(path: Path, by_time: bool = False) -> str:
    """Of a file's content; of Python with the line ends of Unix."""
    try:
        state = path.stat()
        if by_time or state.st_size > LARGE:
            return f"{state.st_size} {state.st_mtime_ns}"
        data = path.read_bytes()
    except OSError as error:
        return type(error).__name__
    return hashlib.sha256(data.replace(b"\r\n", b"\n") if path.suffix == ".py" else data).hexdigest()


def _files(method: Integrator) -> Iterator[tuple[str, str]]:
    """What `uses` names beside methods and plugins: files and folders, by their path from the plugin's own."""
    registry = plugins.registry()
    names = registry.origins.keys() | registry.integrators.keys()
    for name in method.uses:
        if name not in names and "[" not in name and method.plugin in registry.origins:
            path = Path(registry.origins[method.plugin].path).parent / name
            yield name, folder_mark(str(path)) if path.is_dir() else _file_mark(path)
