"""Whether code is installed (told by package and version in a hash) or a user's own, whose content counts."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import sys
import sysconfig
from functools import cache
from pathlib import Path


@cache
def installed(name: str, file: str | None) -> str | None:
    """How code that nobody edits is told: package and version; None for a user's own module.

    name : dotted name of the module; file : where it was loaded from (None for what is built in).
    """
    top = name.partition(".")[0]
    if top == "tcbench":
        return "tcbench"  # its sources are in the fingerprint of every study
    if top == "tcbench_plugins":
        return f"tcbench_plugins={_files_hash(Path(sys.modules[top].__path__[0]))}"
    if top in sys.builtin_module_names or (file is None and top in sys.stdlib_module_names):
        return f"python={platform.python_version()}"
    if file is None:
        return None
    path = Path(file)
    if {"site-packages", "dist-packages"} & set(path.parts):
        return f"{top}={_version(top)}"
    library = Path(sysconfig.get_paths()["stdlib"])
    return f"python={platform.python_version()}" if library in path.parents else None


def _version(top: str) -> str:
    try:
        return importlib.metadata.version(top)
    except importlib.metadata.PackageNotFoundError:  # a package need not be called as its distribution is
        return ",".join(
            importlib.metadata.version(name) for name in importlib.metadata.packages_distributions().get(top, [])
        )


@cache
def _files_hash(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
