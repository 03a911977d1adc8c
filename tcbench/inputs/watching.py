"""A process that is watched: Python's audit hook, the environment, and functions of `os` that no event tells of."""

from __future__ import annotations

import functools
import importlib.metadata
import locale
import os
import platform
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from .callers import FOUND_BY_PYTHON
from .facts import AT_START, NAMES, names_of
from .marks import INSTALLED
from .recorder import ABOUT, LEFT_OUT, LIMITS, STARTED, STATES, Recorder

try:
    import _posixsubprocess
    import resource
except ImportError:  # Windows
    _posixsubprocess = resource = None  # type: ignore[assignment]

NO_INPUTS = ("__editable__", "_distutils_hack", "_virtualenv")  # at their start, of modules that .pth files import
ASKING = ("stat", "lstat", "access", "readlink", "getcwd", "getcwdb", "open")
_RECORDER: Recorder | None = None
_HOOKED = False
_FIRST: tuple[str, ...] = AT_START  # modules that were imported before tcbench
_PLAIN: dict[tuple[Any, str], Any] = {}  # functions that others stand for while this process is watched
_ENVIRONMENT = type(os.environ)


class _Watched(_ENVIRONMENT):  # type: ignore[valid-type,misc]
    """The environment, which says what is asked of it."""

    _walked: tuple[Any, ...] = ()  # names that a walk over all of them gave and whose values it has not taken yet

    def __getitem__(self, name: Any) -> Any:
        if _RECORDER is not None and self._walked[:1] != (name,):
            self._walked = ()
            _RECORDER.asked(name)
        self._walked = self._walked[1:]
        return super().__getitem__(name)

    def __contains__(self, name: Any) -> bool:
        if _RECORDER is not None:
            _RECORDER.asked(name)
        return bool(super().__contains__(name))

    def __iter__(self) -> Any:
        self._all()
        self._walked = ()
        for name in super().__iter__():
            self._walked += (name,)
            yield name

    def __len__(self) -> int:
        self._all()
        return int(super().__len__())

    def __repr__(self) -> str:
        self._all()
        return str(super().__repr__())

    def _all(self) -> None:
        if _RECORDER is not None:
            for name in (NAMES, *names_of(map(os.fsdecode, list(self._data)))):
                _RECORDER.asked(name)


def begin() -> Recorder:
    """Watch this process from now on; what it has done before is not looked at."""
    global _RECORDER, _HOOKED
    if _RECORDER is None:
        for folder in [f for f in sys.path_importer_cache if not (f + os.sep).startswith(INSTALLED)]:
            del sys.path_importer_cache[folder]  # its modules are read as they are written now (`loading.files`)
        _RECORDER = Recorder()
        _stand_in_for_all(_RECORDER)
        sys.meta_path.insert(0, _RECORDER)
        for environment in (os.environ, getattr(os, "environb", os.environ)):
            environment.__class__ = _Watched
        for name in (name for name in _FIRST if not name.startswith(NO_INPUTS)):
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


def first_modules(names: Iterable[str]) -> None:
    """This process had imported these modules before tcbench: .pth files among installed packages may name them."""
    global _FIRST
    _FIRST = tuple(names)


def _stand_in_for_all(recorder: Recorder) -> None:
    if _posixsubprocess is not None:  # multiprocessing starts its processes by it, and no audit event says so
        _stand_in(_posixsubprocess, "fork_exec", lambda *_: recorder.unseen.setdefault(STARTED))
    for module in (os, sys.modules[os.name]):
        for name in ASKING:
            _stand_in(module, name, functools.partial(recorder.looked, name))
        for name in (*ABOUT, *STATES):
            _stand_in(module, name, functools.partial(recorder.about, name))
    for name in LIMITS:
        _stand_in(resource, name, functools.partial(recorder.about, name))
    _stand_in(platform, "uname", functools.partial(recorder.about, "uname"))  # which remembers what it was told
    for name in ("setlocale", "getlocale"):
        _stand_in(locale, name, functools.partial(recorder.about, "setlocale"))
    _stand_in(importlib.metadata, "distribution", recorder.package)
    _stand_in(importlib.metadata, "distributions", lambda **context: recorder.package(context.get("name")))


def _stand_in(module: Any, name: str, before: Callable[..., object]) -> None:
    """From now on `before` is called with the arguments of a module's function, and then the function."""
    if not hasattr(module, name):
        return
    plain = _PLAIN[module, name] = getattr(module, name)

    @functools.wraps(plain)
    def called(*arguments: Any, **named: Any) -> Any:
        if _RECORDER is not None and not sys._getframe(1).f_code.co_filename.startswith(FOUND_BY_PYTHON):
            before(*arguments, **named)
        return plain(*arguments, **named)

    setattr(module, name, called)
    for can in (os.supports_dir_fd, os.supports_fd, os.supports_follow_symlinks, os.supports_effective_ids):
        if plain in can:
            can.add(called)


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
