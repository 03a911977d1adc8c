"""Plugin files: which ones a folder has, and their import, with helpers beside them."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from importlib import machinery
from pathlib import Path
from types import ModuleType
from typing import Any

from ..errors import TcbenchError


def plugin_files(folders: Iterable[Path]) -> list[Path]:
    files: list[Path] = []
    for folder in folders:
        if folder.is_file():  # named by itself, whatever its name
            files.append(_real(folder))
        else:
            paths = sorted(folder.glob("*.py"))
            files.extend(_real(p) for p in paths if not p.name.startswith(("_", "test_", "conftest", "setup")))
    return list(dict.fromkeys(files))


def _real(path: Path) -> Path:
    """Where links lead; one that leads to itself is a file that cannot be read, where Path.resolve raises."""
    return Path(os.path.realpath(path))


class RefusedError(TcbenchError):
    """A plugin file that is not taken as it is; the sentence says all that there is to say."""


_HELPERS: dict[Path, dict[str, ModuleType]] = {}  # folder of plugin files -> the modules there that they have imported


class AsWritten(machinery.SourceFileLoader):
    """Compiles what a file says now. Python takes byte code for current if the source has the size and the whole second
    that it was made from, so a file that a script edits would be measured under its new hash with its old formula."""

    def get_code(self, fullname: str) -> Any:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


def forget_helpers() -> None:
    """What plugin files imported from beside them is imported anew: it may have been edited, or be another folder's."""
    for folder, modules in _HELPERS.items():
        _take_out(modules)
        if str(folder) in sys.path:
            sys.path.remove(str(folder))
    _HELPERS.clear()
    importlib.invalidate_caches()


def import_file(path: Path) -> Any:
    """Import a plugin file under a name of its own; its folder is importable, for helpers beside it.

    Installed packages and Python's own modules come before helpers of their name, so a file called rich.py is in
    nobody's way.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise RefusedError(f"{path.name} is no file, but a folder, a pipe or a device")
    tag = hashlib.sha256(os.fsencode(path)).hexdigest()[:8]
    name = f"tcbench_plugin_{tag}_{path.stem}"
    loader = AsWritten(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    if spec is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: cached kernels and dataclasses look their module up
    try:
        with at_home(path):
            loader.exec_module(module)
    except BaseException:
        sys.modules.pop(name, None)
        raise
    return module


@contextlib.contextmanager
def at_home(path: Path) -> Iterator[None]:
    """Meanwhile imports find what lies beside this plugin file, and nothing that lies beside those of other folders;
    no byte code is written there, which Python would take for current after an edit within the second."""
    home, written = path.parent, sys.dont_write_bytecode
    for folder, modules in _HELPERS.items():
        if folder != home:
            _take_out(modules)
    if str(home) in sys.path and home in _HELPERS:
        sys.path.remove(str(home))
    others = [p for p in sys.path if Path(p) in _HELPERS]
    sys.path[:] = [p for p in sys.path if p not in others] + [str(home)] * (str(home) not in sys.path) + others
    own = _HELPERS.setdefault(home, {})
    sys.modules.update(own)
    before, sys.dont_write_bytecode = set(sys.modules), True
    try:
        yield
    finally:
        sys.dont_write_bytecode = written
        own.update({n: sys.modules[n] for n in set(sys.modules) - before if _beside(path, sys.modules[n])})
        for modules in _HELPERS.values():
            for name, module in modules.items():
                sys.modules.setdefault(name, module)


def _take_out(modules: Mapping[str, ModuleType]) -> None:
    for name, module in modules.items():
        if sys.modules.get(name) is module:
            del sys.modules[name]


def _beside(path: Path, module: ModuleType) -> bool:
    """Whether a module lies in the file's folder, and not in an environment that lies there, too."""
    file = Path(getattr(module, "__file__", None) or "/")
    nearer = (Path(p) for p in sys.path if p and Path(p) != path.parent and Path(p).is_relative_to(path.parent))
    return file.is_relative_to(path.parent) and not any(file.is_relative_to(p) for p in nearer)
