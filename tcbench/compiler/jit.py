"""numba, set up once: where compiled code is cached, and how a kernel is called by its address.

The cache folder is named after a hash of tcbench's numerical sources and of the numba, numpy and Python
versions, because numba's own cache does not notice an edit in a callee that lives in another file.
With NUMBA_DISABLE_JIT=1 everything here runs as plain Python: same results, for coverage and debugging.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numba import config as _config
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from platformdirs import user_cache_dir

from ..errors import TcbenchError

NUMERICAL_PACKAGES = ("compiler", "systems", "solver", "simulation")  # what compiled code is made of
config: Any = _config  # its attributes are made at run time
DISABLED = bool(config.DISABLE_JIT)
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}  # contract: fused multiply-add


def numerical_sources() -> list[Path]:
    """Every file that compiled code may depend on, found by looking: a list by hand forgets what is renamed."""
    root = Path(__file__).parent.parent
    found = []
    for name in NUMERICAL_PACKAGES:
        files = sorted((root / name).rglob("*.py"))
        if not files:
            raise TcbenchError(
                f"tcbench's numerical package {name!r} has no sources: {str(root / name)!r} is incomplete."
            )
        found += files
    return found


@cache
def sources_hash(folder: Path | None = None) -> str:
    """Hash of tcbench's numerical sources, those of a plugin's own folder, and of what compiles and runs them."""
    digest = hashlib.sha256()
    for name in ("numba", "numpy", "llvmlite"):
        digest.update(f"{name}={version(name)};".encode())
    digest.update(f"python={platform.python_version()};{platform.machine()};".encode())
    for path in [*numerical_sources(), *(sorted(folder.glob("*.py")) if folder else [])]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_folder(plugin: Path | None = None) -> Path:
    """Where compiled kernels live: $TCBENCH_CACHE_DIR, or the user's cache folder; of a plugin's folder, its own."""
    root = os.environ.get("TCBENCH_CACHE_DIR") or user_cache_dir("tcbench", appauthor=False)
    folder = Path(root) / f"kernels-{sources_hash(plugin)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        raise TcbenchError(
            f"The cache of compiled code, {str(folder)!r}, cannot be written. "
            "Set TCBENCH_CACHE_DIR to a folder that can."
        )
    return folder


def _plugin_folder(function: Callable[..., Any]) -> Path | None:
    """The folder of a function that is not tcbench's own."""
    path = Path(function.__code__.co_filename).resolve()
    return None if Path(__file__).resolve().parent.parent in path.parents else path.parent


@contextmanager
def own_cache(function: Callable[..., Any]) -> Iterator[None]:
    """numba's cache in tcbench's folder, for what is decorated inside; its setting is left as the user has it."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(cache_folder(_plugin_folder(function)))
    try:
        yield
    finally:
        config.CACHE_DIR = before


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """njit with tcbench's options and cache folder."""
    with own_cache(function):
        return njit(cache=True, nogil=True, **OPTIONS, **options)(function)


def lean(function: Callable[..., Any]) -> Any:
    """`compiled` without reference counts, which cost 0.3 us a step: such a function allocates and slices nothing."""
    return compiled(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """`lean`, and part of its caller: to pass a tuple of many arrays costs more than what a small function does."""
    return compiled(function, _nrt=False, forceinline=True)


# kernels under NUMBA_DISABLE_JIT: made-up address -> Python function
PYTHON_KERNELS: dict[int, Callable[[Any, Any, Any], None]] = {}

if DISABLED:

    def call(address: int, a: Any, b: Any, out: Any) -> None:
        PYTHON_KERNELS[int(address)](a, b, out)

else:

    @intrinsic
    def call(typingctx, address, a, b, out):  # type: ignore[no-untyped-def]
        """Run the kernel at `address` on three float64 arrays: kernel(a, b, out)."""
        if not all(isinstance(x, types.Array) and x.dtype == types.float64 for x in (a, b, out)):
            return None
        signature = types.void(types.int64, a, b, out)

        def codegen(context, builder, sig, args):  # type: ignore[no-untyped-def]
            pointers = [
                context.make_array(ty)(context, builder, value).data
                for ty, value in zip(sig.args[1:], args[1:], strict=True)
            ]
            ir = cgutils.ir
            function_type = ir.FunctionType(ir.VoidType(), [p.type for p in pointers])
            function = builder.inttoptr(args[0], function_type.as_pointer())
            builder.call(function, pointers)
            return context.get_dummy_value()

        return signature, codegen


@lean
def copy_into(target, source):  # type: ignore[no-untyped-def]
    """target[:] = source, for functions that are `lean`."""
    for i in range(len(source)):
        target[i] = source[i]


@lean
def fill(target, value):  # type: ignore[no-untyped-def]
    """target[:] = value, for functions that are `lean`."""
    for i in range(len(target)):
        target[i] = value


@compiled
def evaluate(address: int, a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Run one kernel from Python (two microseconds of overhead)."""
    call(address, a, b, out)


@compiled
def evaluate_rows(address: int, a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Run one kernel on each row of `a`, into the rows of `out`."""
    for i in range(len(a)):
        call(address, a[i], b, out[i])
