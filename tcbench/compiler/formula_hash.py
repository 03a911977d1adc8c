"""`content_hash` of what sees nothing else: two formulas with one `formula_hash` give the same numbers.

What is traced once and used again stands on this. A formula that may read more than the hash covers (a file, the
environment, the clock, a generator of chance, names that it computes) has none, and is traced each time.
"""

from __future__ import annotations

import types
from typing import Any

from .code_hash import Hasher, HashlessError, code_of, hashed

# modules whose functions see nothing but their arguments; of numpy, not those that read files or draw numbers
PURE = frozenset({
    "tcbench", "tcbench_plugins", "numpy", "scipy", "builtins", "math", "cmath", "_operator", "operator", "functools",
    "_functools", "itertools", "collections", "_collections", "_collections_abc", "numbers", "fractions", "dataclasses",
    "enum", "typing", "types", "abc", "__future__", "copy", "contextlib",
})  # fmt: skip
READERS = frozenset({
    "load", "loadtxt", "genfromtxt", "fromfile", "fromregex", "memmap", "DataSource", "random", "default_rng", "open",
    "attrgetter", "methodcaller", "import_module", "__import__",
})  # fmt: skip


def formula_hash(*objects: Any) -> str | None:
    """Sha256, hexadecimal, of what these objects are and compute; None where they may read more than that."""
    return hashed(_Pure(), objects)


class _Pure(Hasher):
    """Refuses what may read more than the hash covers."""

    def home(self, name: str, file: str | None) -> str | None:
        found = super().home(name, file)
        if found is not None and name.partition(".")[0] not in PURE:
            raise HashlessError(f"something of {name}")
        return found

    def _object(self, item: Any) -> None:
        if isinstance(item, types.BuiltinFunctionType) and item.__module__:
            self.home(item.__module__, None)
        super()._object(item)

    def _function(self, function: types.FunctionType) -> None:
        if self.home(str(function.__globals__.get("__name__", "")), function.__globals__.get("__file__")) is None:
            code = code_of(function.__code__)
            if READERS & (code.attributes | set(code.names)):
                raise HashlessError("something that reads")
        elif function.__name__ in READERS:
            raise HashlessError(function.__name__)
        super()._function(function)
