"""Calls of kernels by address, through LLVM code that reads numpy's arrays itself: faster than ctypes."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from .caches import LOCK
from .machine import addresses
from .records import HEAD, address_of

CONTIGUOUS, ALIGNED, WRITEABLE = 0x1, 0x100, 0x400  # flags of numpy's arrays
_ARRAYS = ("a", "b", "out")


def _checked_call() -> str:
    """LLVM code of evaluate(kernel, a, b, out) on numpy's objects. It returns 1 and does nothing unless all three are
    contiguous arrays of doubles and the last can be written; their layout is numpy's binary interface."""
    lines = ["@kinds = global [2 x i64] zeroinitializer"]
    lines.append("define i64 @evaluate(i64 %kernel, ptr %a, ptr %b, ptr %out) {\nentry:")
    lines.append("  %array = load i64, ptr @kinds\n  %at = getelementptr i64, ptr @kinds, i64 1")
    lines.append("  %double = load i64, ptr %at\n  %ok0 = icmp eq i64 0, 0")
    count = 0
    for x in _ARRAYS:
        for what, offset, kind in (("type", HEAD - 8, "i64"), ("descr", HEAD + 40, "i64"), ("flags", HEAD + 48, "i32")):
            lines.append(f"  %{x}.{what}.at = getelementptr i8, ptr %{x}, i64 {offset}")
            lines.append(f"  %{x}.{what} = load {kind}, ptr %{x}.{what}.at")
        needed = CONTIGUOUS | ALIGNED | (WRITEABLE if x == "out" else 0)
        lines.append(f"  %{x}.bits = and i32 %{x}.flags, {needed}")
        tests = (f"i64 %{x}.type, %array", f"i64 %{x}.descr, %double", f"i32 %{x}.bits, {needed}")
        for test in tests:
            lines.append(f"  %test{count} = icmp eq {test}")
            lines.append(f"  %ok{count + 1} = and i1 %ok{count}, %test{count}")
            count += 1
    lines.append(f"  br i1 %ok{count}, label %go, label %no\nno:\n  ret i64 1\ngo:")
    for x in _ARRAYS:
        lines.append(f"  %{x}.at = getelementptr i8, ptr %{x}, i64 {HEAD}\n  %{x}.data = load ptr, ptr %{x}.at")
    lines.append("  %pointer = inttoptr i64 %kernel to ptr")
    lines.append("  call void %pointer(ptr %a.data, ptr %b.data, ptr %out.data)\n  ret i64 0\n}")
    lines.append("define void @run_kernel(i64 %kernel, ptr %a, ptr %b, ptr %out) {\nentry:")
    lines.append(
        "  %pointer = inttoptr i64 %kernel to ptr\n  call void %pointer(ptr %a, ptr %b, ptr %out)\n  ret void\n}"
    )
    return "\n".join(lines)


NATIVE: list[Any] = []


def native() -> list[Any]:
    """[evaluate, run_kernel] of `_checked_call` as ctypes functions that keep the lock: they are short."""
    with LOCK:
        if not NATIVE:
            checked, unchecked, kinds = addresses(["evaluate", "run_kernel", "kinds"], _checked_call)
            (ctypes.c_int64 * 2).from_address(kinds)[:] = [id(np.ndarray), id(np.dtype(np.float64))]
            words = [ctypes.c_ssize_t] * 4
            NATIVE[:] = [ctypes.PYFUNCTYPE(x, *words)(f) for x, f in ((ctypes.c_ssize_t, checked), (None, unchecked))]
    return NATIVE


def run_kernel(kernel: int, a: Any, b: Any, out: Any) -> None:
    """Run a kernel, by its address, on contiguous float64 arrays; this is not checked."""
    native()[1](kernel, address_of(a), address_of(b), address_of(out))
