"""Plugin files: which ones a folder has, and their import, with helpers beside them."""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterable
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, ExtensionFileLoader, FileFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from . import inputs
from .errors import TcbenchError


def plugin_files(folders: Iterable[Path]) -> list[Path]:
    files: list[Path] = []
    for folder in folders:
        found = [folder] if folder.is_file() else sorted(folder.glob("*.py"))
        files.extend(p.resolve() for p in found if not p.name.startswith(("_", "test_", "conftest", "setup")))
    return list(dict.fromkeys(files))


class RefusedError(TcbenchError):
    """A plugin file that is not taken as it is; the sentence says all that there is to say."""


_HELPERS: dict[str, ModuleType] = {}  # modules beside plugin files that these have imported
_PATHS: list[str] = []  # what was added to sys.path
_FOLDERS: set[Path] = set()  # of the files that were imported


class AsWritten(SourceFileLoader):
    """Compiles what a file says now. Python takes byte code for current if the source has the size and the whole second
    that it was made from, so a file that a script edits would be measured under its new hash with its old formula."""

    def get_code(self, fullname: str) -> Any:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


def _read_as_written(folder: str) -> Any:
    """A path hook: modules in folders of plugin files, and in packages there, but not in an environment there; where
    reads are noted everything that is not installed, or a row would name the new file and have the old code."""
    path = Path(folder)
    above = next((f for f in _FOLDERS if path.is_relative_to(f)), None)
    watched = inputs.recorder() is not None and not (folder + os.sep).startswith(inputs.INSTALLED)
    if not path.is_dir() or (not watched if above is None else _in_environment(path, above)):
        raise ImportError(f"no plugin files in {folder}")
    return FileFinder(folder, (ExtensionFileLoader, EXTENSION_SUFFIXES), (AsWritten, SOURCE_SUFFIXES))


def _in_environment(path: Path, above: Path) -> bool:
    roots = [Path(prefix) for prefix in (sys.prefix, sys.base_prefix)]
    within = any(root.is_relative_to(above) and path.is_relative_to(root) for root in roots)
    return within or "site-packages" in path.relative_to(above).parts


sys.path_hooks.insert(0, _read_as_written)


def forget_helpers() -> None:
    """What plugin files imported from beside them is imported anew: it may have been edited, or be another folder's."""
    for name, module in _HELPERS.items():
        if sys.modules.get(name) is module:
            del sys.modules[name]
    for path in _PATHS:
        if path in sys.path:
            sys.path.remove(path)
    _HELPERS.clear()
    _PATHS.clear()
    importlib.invalidate_caches()


def import_file(path: Path) -> Any:
    """Import a plugin file under a name of its own; its folder is importable, for helpers beside it.

    Installed packages and Python's own modules come before helpers of their name, so a file called rich.py is in
    nobody's way.
    """
    tag = hashlib.sha256(str(path).encode()).hexdigest()[:8]
    name = f"tcbench_plugin_{tag}_{path.stem}"
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
        _PATHS.append(str(path.parent))
    if path.parent not in _FOLDERS:
        _FOLDERS.add(path.parent)
        sys.path_importer_cache.pop(str(path.parent), None)
    loader = AsWritten(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    if spec is None:
        raise ImportError(f"{path} is not a Python file")
    _refuse_clash(path)
    _refuse_twice(path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: cached kernels and dataclasses look their module up
    before = set(sys.modules)
    try:
        loader.exec_module(module)
    except BaseException:
        sys.modules.pop(name, None)
        raise
    finally:
        _HELPERS.update({new: sys.modules[new] for new in set(sys.modules) - before if _beside(path, sys.modules[new])})
    return module


def _beside(path: Path, module: ModuleType) -> bool:
    """Whether a module lies in the file's folder and is found there, not in an environment that lies in it, too."""
    file = Path(getattr(module, "__file__", None) or "/")
    nearer = (Path(p) for p in sys.path if p and Path(p) != path.parent and Path(p).is_relative_to(path.parent))
    return file.is_relative_to(path.parent) and not any(file.is_relative_to(p) for p in nearer)


def _refuse_clash(path: Path) -> None:
    """A helper beside the file that an import would look for in another plugin folder is a wrong one: refuse it."""
    for name, own in _neighbours(path).items():
        try:
            found = getattr(sys.modules.get(name) or importlib.util.find_spec(name), "__file__", None)
            found = found or getattr(importlib.util.find_spec(name), "origin", None)
        except (ImportError, ValueError):
            continue
        if found and Path(found).resolve() != own and any(str(Path(found).resolve()).startswith(p) for p in _PATHS):
            raise RefusedError(
                f"Two folders have a module {name!r}, and Python would give {path.name} the wrong one: {own} and "
                f"{found}. Rename one of them, or run them apart."
            )


def _refuse_twice(path: Path) -> None:
    """Two hooks of one name: Python keeps the last alone, and what the first brings would be missing without a word."""
    try:
        found = [node for node in ast.parse(path.read_bytes()).body if isinstance(node, ast.FunctionDef)]
    except (SyntaxError, ValueError):
        return  # its import says so
    for name in dict.fromkeys(node.name for node in found if node.name.startswith("tcbench_")):
        lines = [str(node.lineno) for node in found if node.name == name]
        if len(lines) > 1:
            raise RefusedError(
                f"{name} is defined in line {' and again in line '.join(lines)}, and Python keeps the last one only. "
                "Return everything from one function."
            )


def _neighbours(path: Path) -> dict[str, Path]:
    """Modules beside a file that it imports, anywhere in it, directly or through each other: name -> file."""
    found: dict[str, Path] = {}
    waiting = [path]
    while waiting:
        try:
            tree = ast.parse(waiting.pop().read_bytes())
        except (OSError, SyntaxError, ValueError):
            continue
        for node in ast.walk(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and node.module and not node.level else []
            for top in {name.partition(".")[0] for name in names} - set(found):
                for file in (path.parent / f"{top}.py", path.parent / top / "__init__.py"):
                    if file.is_file() and file != path:
                        found[top] = file.resolve()
                        waiting.append(file)
    return found
