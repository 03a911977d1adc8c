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
    replaced = Restored(builtins, time)
    environment, folder = dict(os.environ), ""
    with contextlib.suppress(OSError):  # one that was removed
        folder = os.getcwd()
    try:
        with np.errstate(), contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        replaced.restore()
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


class Restored:
    """What modules and classes have, to be had again."""

    def __init__(self, *owners: Any) -> None:
        self.kept: dict[int, tuple[Any, dict[str, Any]]] = {id(owner): (owner, dict(vars(owner))) for owner in owners}

    def keep(self) -> None:
        """Remember what the modules of numpy and scipy have, and their classes, that was not known yet."""
        for name, module in list(sys.modules.items()):
            if name.partition(".")[0] in ("numpy", "scipy", "math", "cmath") and id(module) not in self.kept:
                for item in (module, *vars(module).values()):
                    if (item is module or isinstance(item, type)) and id(item) not in self.kept:
                        self.kept[id(item)] = item, dict(vars(item))

    def restore(self) -> None:
        """Undo what was replaced since."""
        for owner, before in self.kept.values():
            content = vars(owner)
            for name, value in before.items():
                if content.get(name) is not value:
                    with contextlib.suppress(AttributeError, TypeError):
                        setattr(owner, name, value)
