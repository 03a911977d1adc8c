"""Versions of installed packages; nothing is imported."""

from __future__ import annotations

import importlib.metadata
import importlib.util
from functools import cache


@cache
def installed_version(package: str) -> str | None:
    """Version of a package, by its name as it is installed or imported. None: it is absent.

    "" for what can be imported and has no version, such as a folder on the path.
    """
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "" if package.isidentifier() and importlib.util.find_spec(package) else None
