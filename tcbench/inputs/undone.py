"""What importing plugins does to this process is undone: the engine and other methods would feel it."""

from __future__ import annotations

import builtins
import contextlib
import os
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

_CHANGED: dict[str, tuple[str | None, str | None]] = {}  # variables that plugins have set here: before, and as set


@contextlib.contextmanager
def undone() -> Iterator[None]:
    """What imports do to this process that the engine or other methods would feel is undone: builtins and clocks that
    they replace, numpy's error state, the current folder, output that would stand among results."""
    modules = [(module, dict(vars(module))) for module in (builtins, time)]
    environment, folder = dict(os.environ), ""
    with contextlib.suppress(OSError):  # one that was removed
        folder = os.getcwd()
    try:
        with np.errstate(), contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        for module, before in modules:
            for name, value in before.items():
                if vars(module).get(name) is not value:
                    setattr(module, name, value)
        with contextlib.suppress(OSError):
            if folder and os.getcwd() != folder:
                os.chdir(folder)
        for name in {*environment, *os.environ}:
            before_it, now = environment.get(name), os.environ.get(name)
            if now != before_it:
                known = _CHANGED.get(name)
                _CHANGED[name] = (known[0] if known and known[1] == before_it else before_it), now


def environment() -> dict[str, str]:
    """The environment as it was before any plugin changed it: that of workers."""
    found = dict(os.environ)
    for name, (before, as_set) in _CHANGED.items():
        if found.get(name) == as_set:  # else the user has set it since
            found.pop(name, None)
            found |= {} if before is None else {name: before}
    return found


class Computing:
    """What the modules of numpy and scipy have, and their classes."""

    def __init__(self) -> None:
        self.kept: dict[int, tuple[Any, dict[str, Any]]] = {}

    def keep(self) -> None:
        """Remember what was not known yet."""
        for name, module in list(sys.modules.items()):
            if name.partition(".")[0] in ("numpy", "scipy", "math", "cmath") and id(module) not in self.kept:
                self._keep(module)
                for item in list(vars(module).values()):
                    if isinstance(item, type) and id(item) not in self.kept:
                        self._keep(item)

    def _keep(self, owner: Any) -> None:
        self.kept[id(owner)] = owner, dict(vars(owner))

    def restore(self) -> None:
        """Undo what was replaced since."""
        for owner, before in self.kept.values():
            content = vars(owner)
            for name, value in before.items():
                if content.get(name) is not value:
                    with contextlib.suppress(AttributeError, TypeError):
                        setattr(owner, name, value)
