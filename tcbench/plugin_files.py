"""Plugin files: which ones a folder has, and their import, with helpers beside them."""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from .errors import TcbenchError


def plugin_files(folders: Iterable[Path]) -> list[Path]:
    files: list[Path] = []
    for folder in folders:
        found = [folder] if folder.is_file() else sorted(folder.glob("*.py"))
        files.extend(p.resolve() for p in found if not p.name.startswith(("_", "test_", "conftest", "setup")))
    return list(dict.fromkeys(files))


CLASH = "Two folders have a module "
_HELPERS: dict[str, ModuleType] = {}  # modules beside plugin files that these have imported
_PATHS: list[str] = []  # what was added to sys.path


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
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    _refuse_clash(path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: cached kernels and dataclasses look their module up
    before = set(sys.modules)
    try:
        spec.loader.exec_module(module)
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
            raise TcbenchError(
                f"{CLASH}{name!r}, and Python would give {path.name} the wrong one: {own} and {found}. Rename one of "
                "them, or run them apart."
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
