"""From restricted Python to LLVM: kernels, special functions and loops.

Translated are functions with annotated arguments and results; assignment, if, while, for over range, break,
continue, return; numbers, arrays and records (`records`) with arithmetic, comparison, and/or/not, x if t else y, min,
max, abs, len, sqrt and the like, indexing, calls of such functions, and `call(kernel, a, b, out)`. A local name has the
kind of its first value. All else is refused, with function, line and text, and so are texts that would be wrong in
silence: a name that may be unset, a function without a final return, recursion, text that is never reached.
"""

from __future__ import annotations

import ast
import linecache
from collections import ChainMap
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType, FunctionType
from typing import Any

from .formula_hash import code_digest
from .statements import Body
from .values import BOOL, FUSED, INT, NOTHING, Array, Several, TranslationError, kind_of, machine_kinds

KERNEL = Array(sized=False)
TABLE = "@table = global ptr null"
LATE, MAKER = "late.", "maker."  # prefixes of globals: a late function's address, and the function that compiles it


@dataclass(frozen=True)
class Function:
    """A translated function, as its callers see it."""

    name: str  # of LLVM
    title: str  # in messages
    arguments: dict[str, Any]
    result: Any
    fused: str  # flag of its floating-point operations
    late: bool = False  # does its name stand for a place where its address is?

    @property
    def result_code(self) -> str:
        kinds = machine_kinds(self.result)
        return f"{{{', '.join(kinds)}}}" if isinstance(self.result, Several) else kinds[0]


def _all_functions(body: Iterable[ast.stmt]) -> Iterable[ast.FunctionDef]:
    for node in body:
        if isinstance(node, ast.FunctionDef):
            yield node
        for inner in ("body", "orelse", "handlers", "finalbody"):
            yield from _all_functions(getattr(node, inner, ()))


@lru_cache(maxsize=64)
def _functions(text: str) -> dict[tuple[str, str], ast.FunctionDef]:
    """The functions of a source by name and digest of their bytecode."""
    tree = ast.parse(text)
    nodes = {(f.name, min([f.lineno, *(d.lineno for d in f.decorator_list)])): f for f in _all_functions(tree.body)}
    tree_of, inner = {}, [compile(tree, "<text>", "exec", dont_inherit=True)]
    while inner:
        code = inner.pop()
        if (code.co_name, code.co_firstlineno) in nodes:
            tree_of[code.co_name, code_digest(code)] = nodes[code.co_name, code.co_firstlineno]
        inner += [x for x in code.co_consts if isinstance(x, CodeType)]
    return tree_of


def source_tree(code: CodeType, *texts: str) -> ast.FunctionDef:
    """The syntax tree of a function, found by its bytecode: a file may have been edited since it was imported.

    texts : of the file, at the times when it was read.
    """
    for text in texts:
        with suppress(KeyError, SyntaxError, ValueError):
            return _functions(text)[code.co_name, code_digest(code)]
    raise TranslationError(
        f"{code.co_filename}: {code.co_name}(), as it was imported, is not in this file (any more) and "
        "cannot be translated. Save it there and start Python anew."
    )


@dataclass
class Module:
    """One LLVM module under construction."""

    sources: dict[str, str] = field(default_factory=dict)  # by file, its text when it was read
    root: Any = None  # the late function that this module is made for
    late: dict[FunctionType, Function] = field(default_factory=dict)
    functions: dict[Any, Function] = field(default_factory=dict)
    code: list[str] = field(default_factory=list)
    declared: dict[str, int] = field(default_factory=dict)
    open: list[Any] = field(default_factory=list)  # functions that are being translated
    external: set[str] = field(default_factory=set)  # declarations of C functions with other arguments than doubles
    numbers: Any = None  # the object that a kernel's text calls its table

    def declare(self, name: str, count: int) -> None:
        self.declared[name] = count

    def text(self) -> str:
        declarations = [f"declare double @{n}({', '.join(['double'] * k)})" for n, k in self.declared.items()]
        return "\n".join([*self.code, *declarations, *sorted(self.external), "!0 = !{}", ""])

    def table(self) -> str:
        """Declare the global with the address of the kernel's table, which is set when the code is loaded."""
        if TABLE not in self.code:
            self.code.append(TABLE)
        return "@table"

    def function(self, function: FunctionType) -> Function:
        """The translation of a Python function, made when it is first asked for."""
        if function in self.functions:
            return self.functions[function]
        names: Mapping[str, Any] = function.__globals__
        if getattr(function, "late", False) and function is not self.root:
            return self.late.get(function) or self._later(function, names)
        file = function.__code__.co_filename
        tree = source_tree(function.__code__, self.sources.get(file, ""), _text_now(function))
        if function.__closure__:
            names = ChainMap(_closure(function), names)  # type: ignore[arg-type]
        hint = "noinline" if getattr(function, "rare", False) else "alwaysinline" if _is_small(tree) else ""
        name = f'@"{len(self.functions) + len(self.open)}.{function.__name__}"'
        form = "{}" if function is self.root else f"internal {{}} {hint}"
        return self._translate(function, name, tree, names, file, form, function.__annotations__)

    def _later(self, function: FunctionType, names: Mapping[str, Any]) -> Function:
        """The global with a late function's address: at first that of a function that compiles and stores it."""
        self.sources.setdefault(function.__code__.co_filename, _text_now(function))
        place = f'@"{LATE}{len(self.late)}"'
        kinds = {name: kind_of(kind, names) for name, kind in function.__annotations__.items()}
        result = kinds.pop("return")
        stub = self.late[function] = Function(place, f"{function.__name__}()", kinds, result, "", late=True)
        parts = [f"{m} %{a}{i}" for a, kind in kinds.items() for i, m in enumerate(machine_kinds(kind))]
        first, maker = f'@"first.{len(self.late) - 1}"', f'@"{MAKER}{len(self.late) - 1}"'
        call = f"call {stub.result_code} %code({', '.join(parts)})"
        lines = [f"{place} = global ptr {first}", f"{maker} = global ptr null"]
        lines.append(f"define internal {stub.result_code} {first}({', '.join(parts)}) noinline nounwind {{")
        lines += [f"  %make = load ptr, ptr {maker}", "  call void %make()", f"  %code = load ptr, ptr {place}"]
        nothing = result == NOTHING
        lines += [f"  {call}", "  ret void"] if nothing else [f"  %value = {call}", f"  ret {stub.result_code} %value"]
        self.code.append("\n".join([*lines, "}"]))
        return stub

    def kernel(self, text: str, names: Mapping[str, Any]) -> None:
        """Add the kernel(a, b, out) of a text to the module."""
        self.numbers = names.get("table")
        (tree,) = (node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef))
        self._translate(text, "@kernel", tree, names, "<kernel>", "{}", None)

    def _translate(
        self,
        key: Any,
        name: str,
        tree: ast.FunctionDef,
        names: Mapping[str, Any],
        file: str,
        form: str,
        kinds: Mapping[str, Any] | None,
    ) -> Function:
        title = f"{tree.name}()"
        if key in self.open:
            raise TranslationError(f"{file}, line {tree.lineno}: {title} calls itself; recursion is not translated.")
        arguments = {a.arg: KERNEL if kinds is None else kind_of(kinds[a.arg], names) if a.arg in kinds else None
                     for a in tree.args.args}  # fmt: skip
        result = NOTHING if kinds is None else kind_of(kinds["return"], names) if "return" in kinds else None
        translated = Function(name, title, arguments, result, "" if getattr(key, "exact", False) else FUSED)
        self.open.append(key)
        body = Body(self, translated, tree, names, file)
        self.open.remove(key)
        self.functions[key] = translated
        parts = [f"{m} %{a}{i}" for a, kind in arguments.items() for i, m in enumerate(machine_kinds(kind))]
        linkage, _, hint = form.partition("{}")
        head = f"define {linkage}{translated.result_code} {name}({', '.join(parts)}){hint} nounwind {{"
        self.code.append("\n".join([head, "entry:", *body.allocations, *body.lines, "}"]))
        return translated

    def entry(self, function: FunctionType, name: str) -> Function:
        """Add a function for ctypes: numbers are passed by value, records by address, arrays by address and lengths;
        several results are written to an address, the last argument."""
        callee = self.function(function)
        parts = [f"{m} %{a}{i}" for a, kind in callee.arguments.items() for i, m in enumerate(machine_kinds(kind))]
        bools = [(a, f"%{a}0") for a, kind in callee.arguments.items() if kind == BOOL]
        outer = [p.replace("i1 ", "i64 ") if p.startswith("i1 ") else p for p in parts]
        lines = [f"  %{a}bool = icmp ne i64 {code}, 0" for a, code in bools]
        inner = [f"i1 %{p[4:-1]}bool" if p.startswith("i1 ") else p for p in parts]
        call, result = f"call {callee.result_code} {callee.name}({', '.join(inner)})", callee.result
        if result == NOTHING:
            lines += [f"  {call}", "  ret void"]
        elif isinstance(result, Several):
            outer.append("ptr %results")
            lines.append(f"  %result = {call}")
            for i, kind in enumerate(result.kinds):
                lines.append(f"  %part{i} = extractvalue {callee.result_code} %result, {i}")
                lines += [f"  %wide{i} = zext i1 %part{i} to i64"] if kind == BOOL else []
                lines.append(f"  %at{i} = getelementptr i64, ptr %results, i64 {i}")
                lines.append(f"  store {f'i64 %wide{i}' if kind == BOOL else f'{kind} %part{i}'}, ptr %at{i}")
            lines.append("  ret void")
            result = NOTHING
        elif result == BOOL:
            lines += [f"  %result = {call}", "  %wide = zext i1 %result to i64", "  ret i64 %wide"]
            result = INT
        else:
            lines += [f"  %result = {call}", f"  ret {result} %result"]
        head = f'define {result} @"{name}"({", ".join(outer)}) nounwind {{'
        self.code.append("\n".join([head, *lines, "}"]))
        return callee


def _text_now(function: FunctionType) -> str:
    """The file of a function as it is now."""
    file = function.__code__.co_filename
    linecache.checkcache(file)
    return "".join(linecache.getlines(file, dict(function.__globals__)))


def _closure(function: FunctionType) -> dict[str, Any]:
    """The values of the names from the function around it."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    try:
        return {name: cell.cell_contents for name, cell in cells}
    except ValueError:
        raise TranslationError(
            f"{function.__qualname__}(): a name of the function around it has no value yet."
        ) from None


def _is_small(tree: ast.FunctionDef) -> bool:
    """Does a function have arithmetic only? Then it is inlined."""
    return not any(isinstance(node, ast.For | ast.While | ast.Expr) for node in tree.body[1:])
