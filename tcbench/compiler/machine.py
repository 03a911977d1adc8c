"""LLVM code to machine code, kept as object files in the user's cache.

The cache folder is named after a hash of tcbench's numerical sources and of what compiles them, a file after what it
was made of and for which processor. A file carries its checksum: a damaged one is compiled again, never executed.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MachineError, TcbenchError
from ..files import replacing
from .collector import paused

NUMERICAL_PACKAGES = ("compiler", "systems", "solver", "simulation")  # what compiled code is made of
SEAL = b"tcbench object 1\n"  # then the SHA-256 of what follows
TARGET = "TCBENCH_TARGET"  # processor and features to compile for, as in x86-64-v3 or x86-64-v3:-fma
LONG = 4000  # lines of straight-line LLVM code, from which on they are written quickly
LEVELS = ("x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4")  # SSE2, SSE4.2, AVX2, AVX-512


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
    import llvmlite

    digest = hashlib.sha256()
    versions = f"numpy={np.__version__};llvmlite={llvmlite.__version__};python={platform.python_version()};"
    digest.update(f"{versions}{platform.machine()};".encode())
    for path in [*numerical_sources(), *(_below(folder) if folder else [])]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_folder(plugin: Path | None = None) -> Path:
    """Where compiled code lives: $TCBENCH_CACHE_DIR, or the user's cache folder; of a plugin's folder, its own."""
    root = os.environ.get("TCBENCH_CACHE_DIR")
    if not root:
        from platformdirs import user_cache_dir

        root = user_cache_dir("tcbench", appauthor=False)
    folder = Path(root) / f"kernels-{sources_hash(plugin)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        raise MachineError(
            f"The cache of compiled code, {str(folder)!r}, cannot be written. "
            "Set TCBENCH_CACHE_DIR to a folder that can."
        )
    return folder


def plugin_folder(function: Callable[..., Any]) -> Path | None:
    """The folder of a function that is not tcbench's own: of its outermost package, whose parts may use each other."""
    path = Path(function.__code__.co_filename).resolve()
    if Path(__file__).resolve().parent.parent in path.parents:
        return None
    folder = path.parent
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


def _below(folder: Path) -> list[Path]:
    """The Python files of a folder and of the packages in it."""
    packages = [package.parent for package in folder.glob("*/__init__.py")]
    return sorted([*folder.glob("*.py"), *(path for package in packages for path in package.rglob("*.py"))])


# object files -------------------------------------------------------------------------------------------------------


def sealed(content: bytes) -> bytes:
    return SEAL + hashlib.sha256(content).digest() + content


def unsealed(data: bytes) -> bytes | None:
    """What was sealed; None if it is damaged."""
    seal, check, content = data[: len(SEAL)], data[len(SEAL) : len(SEAL) + 32], data[len(SEAL) + 32 :]
    return content if seal == SEAL and hashlib.sha256(content).digest() == check else None


def kept(path: Path, make: Callable[[], bytes]) -> bytes:
    """The content of a sealed file; made and written where there is none, or a damaged one."""
    try:
        content = unsealed(path.read_bytes())
    except OSError:
        content = None
    if content is None:
        content = make()
        try:
            with replacing(path) as temporary, temporary.open("wb") as file:
                file.write(sealed(content))
                file.flush()
                os.fsync(file.fileno())  # a power cut must not leave a name without its content
        except OSError as error:
            raise MachineError(
                f"Compiled code cannot be written to {str(path.parent)!r}: {error.strerror or error}. "
                "Make room there, or set TCBENCH_CACHE_DIR to another folder."
            ) from error
    return content


# machine code -------------------------------------------------------------------------------------------------------


@cache
def target() -> tuple[str, str]:
    """(processor, features) to compile for: this machine's, or those of $TCBENCH_TARGET."""
    import llvmlite.binding as llvm

    asked, host = os.environ.get(TARGET, ""), llvm.get_host_cpu_name()
    if not asked:
        return host, llvm.get_host_cpu_features().flatten()
    cpu, _, features = asked.partition(":")
    known = [host, *(LEVELS if platform.machine().lower() in ("x86_64", "amd64") else ())]
    if cpu not in known:  # LLVM would end the process
        raise TcbenchError(f"{TARGET} names no processor known here: {cpu!r}. Known: {', '.join(known)}.")
    return cpu, features


@cache
def _machine(level: int = 3) -> Any:
    """What writes machine code. level: 1 leaves out the second scheduling of instructions, whose time grows as the
    square of the length of straight-line code, and little else."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = target()
    return llvm.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=level, jit=True)


def _made(code: Callable[[], str], loops: bool) -> bytes:
    with paused():
        text = code()
    return compile_object(text, loops)


def compile_object(code: str, loops: bool) -> bytes:
    """Optimised object code of a module. loops: code with short loops, which vectors and unrolling make slower; of
    straight-line code the first level of LLVM's passes makes the same object as the last."""
    import llvmlite.binding as llvm

    machine = _machine()
    module = llvm.parse_assembly(code)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=3 if loops else 1)
    if loops:
        options.loop_vectorization = options.slp_vectorization = False
        options.loop_unrolling = options.loop_interleaving = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    long = not loops and code.count("\n") > LONG
    return bytes((_machine(1) if long else machine).emit_object(module))


_ENGINES: list[Any] = []  # of all that is loaded, for as long as the process lives
_LOADED: dict[str, int] = {}
_TABLES: list[np.ndarray] = []  # that loaded code reads


def addresses(key: str, symbols: Iterable[str], code: Callable[[], str], folder: Path, loops: bool) -> list[int]:
    """Where the symbols of a module stand in memory, from the cache of object files or compiled now.

    key: what tells modules apart; code: gives the LLVM code, called where nothing is in the cache.
    """
    import llvmlite.binding as llvm

    name = hashlib.sha256("\0".join([key, *target()]).encode()).hexdigest()[:24]
    content = kept(folder / f"{'loops' if loops else 'kernel'}_{name}.o", lambda: _made(code, loops))
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    _ENGINES.append(engine)
    return [engine.get_function_address(symbol) for symbol in symbols]


def load(text: str, code: Callable[[str], str], table: np.ndarray | None = None) -> int:
    """Address of a kernel, given by its text (or what tells it apart) and what makes LLVM code of that.

    table: whole numbers that it reads. One piece of machine code serves any table; each has a copy in memory.
    """
    key = text if table is None else text + hashlib.sha256(table.tobytes()).hexdigest()
    if key not in _LOADED:
        symbols = ["kernel", *(["table_at"] if table is not None else [])]
        found = addresses(text, symbols, lambda: code(text), cache_folder(), loops=table is not None)
        if table is not None:
            place = ctypes.CFUNCTYPE(ctypes.c_int64)(found[1])()
            ctypes.c_int64.from_address(place).value = table.ctypes.data
            _TABLES.append(table)
        _LOADED[key] = found[0]
    return _LOADED[key]
