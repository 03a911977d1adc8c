"""Plugin files: which ones a folder has, and their import, with helpers beside them."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterable, Iterator
from importlib import machinery
from pathlib import Path
from types import ModuleType
from typing import Any

from ..errors import TcbenchError
from ..inputs import marks, watching


def plugin_files(folders: Iterable[Path]) -> list[Path]:
    files: list[Path] = []
    for folder in folders:
        if folder.is_file():  # named by itself, whatever its name
            files.append(_real(folder))
        else:
            found = sorted(folder.glob("*.py"))
            files.extend(_real(p) for p in found if not p.name.startswith(("_", "test_", "conftest", "setup")))
    return list(dict.fromkeys(files))


def _real(path: Path) -> Path:
    """Where links lead; one that leads to itself is a file that cannot be read, where Path.resolve raises."""
    return Path(os.path.realpath(path))


class RefusedError(TcbenchError):
    """A plugin file that is not taken as it is; the sentence says all that there is to say."""


_HELPERS: dict[str, ModuleType] = {}  # modules beside plugin files that these have imported
_PATHS: list[str] = []  # what was added to sys.path
_FOLDERS: set[Path] = set()  # of the files that were imported
_BESIDE: dict[Path, None] = {}  # of those that are registered now
_AT_HOME: list[Path] = []  # plugin files that are being imported, or asked for what they bring


class AsWritten(machinery.SourceFileLoader):
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
    watched = watching.recorder() is not None and not (folder + os.sep).startswith(marks.INSTALLED)
    if not path.is_dir() or (not watched if above is None else _in_environment(path, above)):
        raise ImportError(f"no plugin files in {folder}")
    loaders = (machinery.ExtensionFileLoader, machinery.EXTENSION_SUFFIXES), (AsWritten, machinery.SOURCE_SUFFIXES)
    return _Finder(folder, *loaders, (machinery.SourcelessFileLoader, machinery.BYTECODE_SUFFIXES))


class _Finder(machinery.FileFinder):
    """Of modules in a folder of plugin files. When a step runs nobody knows which plugin asks for a helper that two
    folders have, so none gets it."""

    def find_spec(self, fullname: str, target: Any = None) -> machinery.ModuleSpec | None:
        spec = super().find_spec(fullname, target)
        if spec is not None and Path(self.path) in _BESIDE and not _AT_HOME:
            folders = _folders_with(fullname)
            if len(folders) > 1:
                raise RefusedError(
                    f"Two folders have a module {fullname!r}, and Python would give one of their plugins the wrong "
                    f"one: {folders[0]} and {folders[1]}. Rename one of them, import it where the plugin file begins, "
                    "or run them apart."
                )
        return spec


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
    for known in (_HELPERS, _PATHS, _BESIDE):
        known.clear()
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
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
        _PATHS.append(str(path.parent))
    _BESIDE.setdefault(path.parent)
    if path.parent not in _FOLDERS:
        _FOLDERS.add(path.parent)
        sys.path_importer_cache.pop(str(path.parent), None)
    loader = AsWritten(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    if spec is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: cached kernels and dataclasses look their module up
    before = set(sys.modules)
    try:
        with at_home(path):
            try:
                loader.exec_module(module)
            finally:
                new = set(sys.modules) - before
                _HELPERS.update({name: sys.modules[name] for name in new if _beside(path, sys.modules[name])})
    except BaseException:
        sys.modules.pop(name, None)
        raise
    return module


@contextlib.contextmanager
def at_home(path: Path) -> Iterator[None]:
    """Meanwhile imports find what lies beside this plugin file before what lies beside others, by whatever name."""
    home, before = str(path.parent), list(sys.path)
    order = sorted(_PATHS, key=lambda folder: folder != home)
    sys.path[:] = [p for p in sys.path if p not in _PATHS] + [p for p in order if p in before]
    _forget_shared()
    _AT_HOME.append(path)
    try:
        yield
    finally:
        _AT_HOME.pop()
        _forget_shared()


def _forget_shared() -> None:
    """A helper that another folder has by this name, too, is found anew by whoever imports it."""
    for name, module in list(_HELPERS.items()):
        if sys.modules.get(name) is module and len(_folders_with(name.partition(".")[0])) > 1:
            del sys.modules[name]


def _folders_with(name: str) -> list[Path]:
    """The folders of plugin files, of this process, that have a module of this name."""
    files = [name + end for end in (*machinery.SOURCE_SUFFIXES, *machinery.EXTENSION_SUFFIXES, "/__init__.py")]
    return [folder for folder in _BESIDE if any((folder / file).is_file() for file in files)]


def _beside(path: Path, module: ModuleType) -> bool:
    """Whether a module lies in the file's folder and is found there, not in an environment that lies in it, too."""
    file = Path(getattr(module, "__file__", None) or "/")
    nearer = (Path(p) for p in sys.path if p and Path(p) != path.parent and Path(p).is_relative_to(path.parent))
    return file.is_relative_to(path.parent) and not any(file.is_relative_to(p) for p in nearer)
