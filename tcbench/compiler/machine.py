"""From LLVM code to machine code, in object files in the user's cache.

The name of an object file is a hash of its LLVM code, the compiler's versions and the processor: other code never finds
it. The text of a kernel calls only functions of this package: that text and a hash of the package's files stand for its
LLVM code.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import re
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

import numpy as np

from .. import cache as files
from ..errors import MachineError, TcbenchError
from .caches import uncollected

TARGET = "TCBENCH_TARGET"  # processor and features to compile for, as in x86-64-v3 or x86-64-v3:-fma
LINE, ARRAYS, LIBRARY = "a kernel", "a kernel on arrays", "functions"  # kinds of modules
SELDOM = "a kernel that is called once"
LONG = 4000  # lines of straight-line LLVM code from which on it is compiled fast, not optimised
# In long code LLVM searches all lines between a load and its reader, to fold the load into that instruction (29 of 33 s
# for 25,000 lines). A frozen load is not folded.
LOADED = re.compile(r"(%\.\d+) = load (.+), (ptr .+)")
VECTORS, EIGHT = "x double>", "<8 x double>"  # text of short vectors in LLVM code, and of those of eight
LEVELS = ("x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4")  # SSE2, SSE4.2, AVX2, AVX-512
# Code with vectors of four is scheduled for a processor that executes in order: LLVM then weighs latencies, not only
# registers. Series take 1 to 14 % less time; with vectors of eight they would take 10 % more.
IN_ORDER = ' nounwind "tune-cpu"="atom" {'


# machine code -------------------------------------------------------------------------------------------------------


def is_x86() -> bool:
    return platform.machine().lower() in ("x86_64", "amd64")


@cache
def target() -> tuple[str, str]:
    """(processor, features) to compile for: this machine's, or those of $TCBENCH_TARGET."""
    import llvmlite.binding as llvm

    asked, host = os.environ.get(TARGET, ""), llvm.get_host_cpu_name()
    if not asked:
        return host, llvm.get_host_cpu_features().flatten()
    cpu, _, features = asked.partition(":")
    cpus = [host, *(LEVELS if is_x86() else ())]
    if cpu not in cpus:  # LLVM would end the process
        raise TcbenchError(f"{TARGET} names no processor known here: {cpu!r}. Known: {', '.join(cpus)}.")
    return cpu, features


@cache
def _machine(level: int = 3) -> Any:
    """LLVM's target machine. level : 1 leaves out the second scheduling of instructions, whose time grows as the square
    of the length of straight-line code, and little else."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = target()
    return llvm.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=level, jit=True)


def compile_object(code: str, kind: str) -> bytes:
    """Object code of a module, optimised; not that of a kernel that is called once, which then takes a hundredth.

    The loops of functions are short: vectors and unrolling make them slower. Of straight-line code the first level of
    LLVM's passes makes the same object as the last. In kernels on arrays LLVM finds nothing that their graphs have not
    said already, and its time grows faster than their length (11 s of 16 for 50,000 lines): there only counters go into
    registers, and the kernels are as fast.
    """
    import llvmlite.binding as llvm

    long = kind == LINE and code.count("\n") > LONG
    machine = _machine(0 if kind == SELDOM else 1 if kind == ARRAYS or long else 3)
    if long:
        code = LOADED.sub(r"\1.l = load \2, \3\n  \1 = freeze \2 \1.l", code)
    if kind == LINE and is_x86() and VECTORS in code and EIGHT not in code:
        code = code.replace(" nounwind {", IN_ORDER)
    module = llvm.parse_assembly(code)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=3 if kind == LIBRARY else 1)
    if kind == LIBRARY:
        options.loop_vectorization = options.slp_vectorization = False
        options.loop_unrolling = options.loop_interleaving = False
    builder = llvm.create_pass_builder(machine, options)
    passes = llvm.create_new_module_pass_manager() if kind == ARRAYS else builder.getModulePassManager()
    if kind == ARRAYS:
        passes.add_always_inliner_pass()
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
    passes.run(module, builder)
    return bytes(machine.emit_object(module))


@cache
def _compiler() -> str:
    """Everything else that machine code depends on: versions, processor, this package's files."""
    import llvmlite
    import llvmlite.binding as llvm

    versions = (llvmlite.__version__, llvm.llvm_version_info, llvm.get_default_triple(), *target())
    return f"{versions} {files.sources(__package__)}"


def _object(translate: Callable[[], str], key: str | None, kind: str) -> bytes:
    """Machine code of the LLVM code of `translate`, cached under that or under a key that stands for it."""

    def code() -> str:
        with uncollected():
            return translate()

    text = code() if key is None else ""
    name = hashlib.sha256(f"{key or text}\0{_compiler()}\0{kind}".encode("utf-8", "surrogatepass")).hexdigest()
    return files.kept("code", f"{name}.o", lambda: compile_object(text or code(), kind))


_ENGINES: list[Any] = []  # of loaded code, kept alive
_LOADED: dict[Any, int] = {}
_TABLES: list[np.ndarray] = []  # tables that loaded code reads, kept alive


def addresses(
    symbols: Iterable[str], translate: Callable[[], str], key: str | None = None, kind: str = LINE
) -> list[int]:
    """Addresses of functions and globals of a module, loaded from the cache or compiled now.

    translate : returns the LLVM code. key : stands for it, so that a cached module need not be translated.
    """
    import llvmlite.binding as llvm

    content = _object(translate, key, kind)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    _ENGINES.append(engine)
    by_symbol = {symbol: engine.get_global_value_address(symbol) for symbol in symbols}
    missing = [symbol for symbol, address in by_symbol.items() if not address]
    if missing:
        raise MachineError(
            f"Compiled code lacks {', '.join(missing)}: another file lies in its place in the cache, "
            f"{str(files.root())!r}. Run tcbench cache clear."
        )
    return list(by_symbol.values())


def load(
    text: str, code: Callable[[str], str], table: np.ndarray | None = None, by: str = "", seldom: bool = False
) -> int:
    """The address of a kernel. text : its source, or another unique text. code : from that text to LLVM code.

    table : whole numbers that it reads. One object file serves all tables; each table has a copy in memory. by : the
    name of `code`, where that is in this package, so that the text can stand for the LLVM code.
    """
    key = (text, None if table is None else table.tobytes())
    if key not in _LOADED:
        loaded = addresses(
            ["kernel", *(["table"] if table is not None else [])],
            lambda: code(text),
            f"{by} {text}" if by else None,
            SELDOM if seldom else LINE if table is None else ARRAYS,
        )
        if table is not None:
            ctypes.c_int64.from_address(loaded[1]).value = table.ctypes.data
            _TABLES.append(table)
        _LOADED[key] = loaded[0]
    return _LOADED[key]
