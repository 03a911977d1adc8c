"""A process that is watched: Python's audit hook, the environment, and functions of `os` that no event tells of."""

from __future__ import annotations

import functools
import os
import sys
from pathlib import Path
from typing import Any

from .marks import INSTALLED
from .recorder import LEFT_OUT, STARTED, Recorder

try:
    import _posixsubprocess
except ImportError:  # Windows
    _posixsubprocess = None  # type: ignore[assignment]

AT_START = ("sitecustomize", "usercustomize")  # modules that Python imports before anything else
ASKING = ("stat", "lstat", "access", "readlink", "getcwd", "getcwdb", "open")
_RECORDER: Recorder | None = None
_HOOKED = False
_PLAIN: dict[tuple[Any, str], Any] = {}  # functions that others stand for while this process is watched
_ENVIRONMENT = type(os.environ)


class _Watched(_ENVIRONMENT):  # type: ignore[valid-type,misc]
    """The environment, which says what is asked of it."""

    def __getitem__(self, name: Any) -> Any:
        if _RECORDER is not None:
            _RECORDER.asked(name)
        return super().__getitem__(name)

    def __contains__(self, name: Any) -> bool:
        if _RECORDER is not None:
            _RECORDER.asked(name)
        return bool(super().__contains__(name))

    def __iter__(self) -> Any:
        if _RECORDER is not None:
            for name in list(self._data):
                _RECORDER.asked(self.decodekey(name))
            _RECORDER.names()
        return super().__iter__()

    def __len__(self) -> int:
        if _RECORDER is not None:
            _RECORDER.names()
        return int(super().__len__())


def begin() -> Recorder:
    """Watch this process from now on; what it has done before is not looked at."""
    global _RECORDER, _HOOKED
    if _RECORDER is None:
        for folder in [f for f in sys.path_importer_cache if not (f + os.sep).startswith(INSTALLED)]:
            del sys.path_importer_cache[folder]  # its modules are read as they are written now (`plugin_files`)
        _RECORDER = Recorder()
        if _posixsubprocess is not None:  # multiprocessing starts its processes by it, and no audit event says so
            _stand_in(_posixsubprocess, "fork_exec", _starting)
        for name in ASKING:
            _stand_in(os, name, functools.partial(_asking, name))
        sys.meta_path.insert(0, _RECORDER)
        for environment in (os.environ, getattr(os, "environb", os.environ)):
            environment.__class__ = _Watched
        for name in AT_START:
            if file := getattr(sys.modules.get(name), "__file__", None):
                _RECORDER.note(os.path.abspath(file))
        if not _HOOKED:  # a hook stays for the life of a process
            _HOOKED = True
            sys.addaudithook(_hook)
    return _RECORDER


def end() -> None:
    """Watch no longer."""
    global _RECORDER
    if _RECORDER is not None:
        sys.meta_path.remove(_RECORDER)
        for (module, name), plain in _PLAIN.items():
            setattr(module, name, plain)
        _PLAIN.clear()
    _RECORDER = None
    for environment in (os.environ, getattr(os, "environb", os.environ)):
        environment.__class__ = _ENVIRONMENT


def _stand_in(module: Any, name: str, before: Any) -> None:
    """From now on `before` is called with the arguments of a module's function, and then the function."""
    plain = _PLAIN[module, name] = getattr(module, name)

    @functools.wraps(plain)
    def called(*arguments: Any, **named: Any) -> Any:
        before(*arguments, **named)
        return plain(*arguments, **named)

    setattr(module, name, called)
    for can in (os.supports_dir_fd, os.supports_fd, os.supports_follow_symlinks, os.supports_effective_ids):
        if plain in can:
            can.add(called)


def _starting(*arguments: Any) -> None:
    if _RECORDER is not None:
        _RECORDER.unseen.setdefault(STARTED)


def _asking(name: str, path: Any = "", *arguments: Any, dir_fd: Any = None, **named: Any) -> None:
    if _RECORDER is not None and (name != "open" or dir_fd is not None):
        _RECORDER.looked(name, path, dir_fd)


def recorder() -> Recorder | None:
    """Of what this process reads, if it is watched."""
    return _RECORDER


def leave_out(folder: str | Path) -> None:
    """What is read in this folder is tcbench's own: logs, caches."""
    path = os.path.abspath(folder) + os.sep
    if path not in LEFT_OUT:
        LEFT_OUT.append(path)


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _RECORDER is not None and event in _RECORDER.handlers:
        _RECORDER.heard(event, arguments)
