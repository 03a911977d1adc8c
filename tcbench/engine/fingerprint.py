"""The static part of a cell's key: what is certain before it is measured. What foreign code reads is in its inputs."""

from __future__ import annotations

import hashlib
import pkgutil
import platform
import re
import sys
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from .. import plugins
from ..compiler.code_hash import content_hash
from ..compiler.language import PLAIN
from ..inputs import marks
from ..integrator import Integrator
from ..store.cells import UNHASHABLE
from ..store.encoding import canonical_json
from ..store.provenance import machine_name, versions
from ..study import Study
from ..systems.scenario import Scenario
from ..systems.system import System
from .child import given

MAIN = "__main__"
# what an Integrator says of itself, beside what it computes
SAID = ("name", "claims", "source", "tags", "description", "plugin", "base", "parameters", "family", "uses", "requires",
        "starter")  # fmt: skip
# of tcbench: what shows, tells and stores, and computes nothing
NO_NUMBERS = frozenset({"authoring", "cli.py", "commands", "progress.py", "report", "store", "__main__.py"})
# read by C code, which nothing in Python sees
READ_BY_C = re.compile(
    r"(OMP|GOMP|KMP|MKL|OPENBLAS|BLIS|VECLIB|NUMEXPR|NPY|XLA|JAX|TF|CUDA|LLVM)_|"
    r"(LD_PRELOAD|GLIBC_TUNABLES|PYTHON(HASHSEED|OPTIMIZE|WARNINGS|UTF8|INTMAXSTRDIGITS|DEVMODE)|TCBENCH_PLAIN|TCBENCH_TARGET)\Z"
)


def cell_fingerprint(
    study: Study, method: Integrator, scenario: Scenario, options: dict[str, Any], code: str = ""
) -> tuple[str, str]:
    """Hash of what is certain of a cell beside its options, and the machine where it is a timing.

    code : of the scenario's system, where this session may have changed it after it was imported.
    """
    mark = fingerprint(
        scenario=scenario.data(), order=method.order, study=study.name, code=code_mark(), versions=method.versions(),
        metrics=sorted(plugins.metrics()) if study.metrics else [],
        drawn=study.drawn(scenario, options) if study.drawn else None,
        session=[not plugins.is_registered(method), not worker_finds(scenario.system), code],
    )  # fmt: skip
    return mark, machine_name() if study.is_timed(options) else ""


def forget() -> None:
    """Look at everything again: files may have been edited since a run before in this process."""
    code_mark.cache_clear()
    own_sources.cache_clear()


@cache
def code_mark() -> str:
    """What computes, whatever the cell: tcbench's sources, the packages under it, Python, what C code is told."""
    told = {name: value for name, value in given().items() if READ_BY_C.match(name)}
    return fingerprint(
        tcbench=own_sources(), versions=versions(), python=list(sys.version_info[:2]), cpu=platform.machine(),
        told=told, plain=PLAIN, optimize=sys.flags.optimize,
    )[:12]  # fmt: skip


@cache
def own_sources() -> str:
    """One hash of all that tcbench and its own plugins compute with."""
    found = {}
    for folder in map(Path, marks.OWN):
        for path in sorted(folder.rglob("*")):
            relative = path.relative_to(folder)
            if path.suffix in (".py", ".json") and relative.parts[0] not in NO_NUMBERS:
                found[f"{folder.name} {relative.as_posix()}"] = marks.file_hash(str(path))
    return fingerprint(files=found)


def scenario_mark(scenario: Scenario) -> str:
    """What a row says of its scenario, all of its data."""
    return fingerprint(scenario=scenario.data())[:12]


def source_mark(method: Integrator) -> str:
    """What a row says of its method, its `source_hash`: of the plugin's file; of the code of a session's object."""
    if plugins.is_registered(method):
        origin = plugins.registry().origins.get(method.plugin)
        return (marks.file_hash(origin.path) or "")[:12] if origin and origin.path else ""
    return (
        content_hash({f.name: getattr(method, f.name) for f in fields(method) if f.compare and f.name not in SAID})
        or UNHASHABLE
    )[:12]


def worker_finds(system: type[System]) -> bool:
    """Can another process import this class by its name?"""
    if system.__module__ == MAIN or system.__module__ not in sys.modules:
        return False
    try:
        return pkgutil.resolve_name(f"{system.__module__}:{system.__qualname__}") is system
    except (AttributeError, ValueError):  # it is local to a function
        return False


def fingerprint(**parts: Any) -> str:
    """One hash of several JSON values."""
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()
