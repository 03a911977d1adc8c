"""Text of kernels to machine code through LLVM, kept as object files.

The text is the Python that `emit` writes: one operation a line, no loops. numba would compile it too, but its front end
takes ten times as long over such text as LLVM does, half a minute for the largest kernels. Loops stay with numba.
"""

from __future__ import annotations

import ast
import hashlib
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from ..files import replacing
from .jit import cache_folder

DOUBLE, INT = ir.DoubleType(), ir.IntType(64)
POINTER = ir.PointerType(DOUBLE)
FLAGS = ("contract",)  # fused multiply-add
INTRINSICS = {"abs": "fabs", **{name: name for name in ("sqrt", "exp", "log", "sin", "cos")}}
LIBRARY = ("expm1", "log1p", "tanh", "atan")  # of C


def assembly(text: str) -> str:
    """LLVM code of `kernel(a, b, out)`, given in Python; functions of special.py become part of it."""
    module = ir.Module(name="kernel")
    module.triple = llvm.get_default_triple()
    functions = _definitions(text)
    kernel = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER] * 3), name="kernel")
    _Body(module, kernel, functions["kernel"])
    return str(module)


def _definitions(text: str) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}


@cache
def _special() -> tuple[dict[str, ast.FunctionDef], dict[str, float]]:
    """The functions of special.py and its constants."""
    text = Path(__file__).with_name("special.py").read_text(encoding="utf-8")
    constants: dict[str, float] = {}
    for node in ast.parse(text).body:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Constant(value=float(value))):
                constants[name] = value
    return _definitions(text), constants


class _Body:
    """Translates one function: assignments, `if ...: return ...`, return, and expressions of doubles."""

    def __init__(self, module: ir.Module, function: ir.Function, source: ast.FunctionDef) -> None:
        self.module = module
        self.build = ir.IRBuilder(function.append_basic_block())
        self.known: dict[str, Any] = {"inf": ir.Constant(DOUBLE, math.inf)}
        self.known |= {name: ir.Constant(DOUBLE, value) for name, value in _special()[1].items()}
        self.known |= dict(zip((x.arg for x in source.args.args), function.args, strict=True))
        self._statements(source.body)
        if not self.build.block.is_terminated:
            self.build.ret_void()

    def _statements(self, body: list[ast.stmt]) -> None:
        for line in body:
            if isinstance(line, ast.Assign):
                self._assign(line.targets[0], self._value(line.value))
            elif isinstance(line, ast.Return):
                self.build.ret(self._value(line.value))
            elif isinstance(line, ast.If):
                with self.build.if_then(self._value(line.test)):
                    self._statements(line.body)
            elif not isinstance(line, ast.Expr | ast.Pass):
                raise NotImplementedError(ast.unparse(line))

    def _assign(self, target: ast.expr, value: Any) -> None:
        if isinstance(target, ast.Tuple):
            for i, part in enumerate(target.elts):
                self._assign(part, self.build.extract_value(value, i))
        elif isinstance(target, ast.Subscript):
            self.build.store(value, self._place(target))
        else:
            assert isinstance(target, ast.Name)
            self.known[target.id] = value

    def _place(self, node: ast.Subscript) -> Any:
        assert isinstance(node.slice, ast.Constant)
        return self.build.gep(self._value(node.value), [ir.Constant(INT, node.slice.value)], source_etype=DOUBLE)

    def _value(self, node: Any) -> Any:
        return getattr(self, f"_{type(node).__name__.lower()}")(node)

    def _constant(self, node: ast.Constant) -> Any:
        return ir.Constant(DOUBLE, float(node.value))  # type: ignore[arg-type]

    def _name(self, node: ast.Name) -> Any:
        return self.known[node.id]

    def _tuple(self, node: ast.Tuple) -> Any:
        values = [self._value(x) for x in node.elts]
        result: Any = ir.Constant(ir.LiteralStructType([DOUBLE] * len(values)), ir.Undefined)
        for i, value in enumerate(values):
            result = self.build.insert_value(result, value, i)
        return result

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        assert isinstance(node.op, ast.USub)
        return self.build.fneg(self._value(node.operand))

    def _binop(self, node: ast.BinOp) -> Any:
        operation = {"Add": "fadd", "Sub": "fsub", "Mult": "fmul", "Div": "fdiv"}[type(node.op).__name__]
        return getattr(self.build, operation)(self._value(node.left), self._value(node.right), flags=FLAGS)

    def _compare(self, node: ast.Compare) -> Any:
        assert isinstance(node.ops[0], ast.Lt)
        return self.build.fcmp_ordered("<", self._value(node.left), self._value(node.comparators[0]))

    def _subscript(self, node: ast.Subscript) -> Any:
        if isinstance(node.value, ast.Call):  # one of the results of a function
            assert isinstance(node.slice, ast.Constant)
            return self.build.extract_value(self._value(node.value), node.slice.value)
        return self.build.load(self._place(node), typ=DOUBLE)

    def _call(self, node: ast.Call) -> Any:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id  # type: ignore[attr-defined]
        args = [self._value(x) for x in node.args]
        if name in ("max", "min"):  # as in Python: the first, unless the second is beyond it
            first, second = args
            beyond = self.build.fcmp_ordered(">" if name == "max" else "<", second, first)
            return self.build.select(beyond, second, first)
        if name in INTRINSICS:
            return self.build.call(self._declared(f"llvm.{INTRINSICS[name]}.f64"), args)
        return self.build.call(self._declared(name) if name in LIBRARY else self._special(name), args)

    def _declared(self, name: str) -> Any:
        known = self.module.globals.get(name)
        return known or ir.Function(self.module, ir.FunctionType(DOUBLE, [DOUBLE]), name=name)

    def _special(self, name: str) -> Any:
        known = self.module.globals.get(name)
        if known is not None:
            return known
        source = _special()[0][name]
        returned = source.body[-1]
        assert isinstance(returned, ast.Return)
        pair = isinstance(returned.value, ast.Tuple)
        kind = ir.FunctionType(ir.LiteralStructType([DOUBLE] * 2) if pair else DOUBLE, [DOUBLE])
        function = ir.Function(self.module, kind, name=name)
        function.linkage = "internal"
        function.attributes.add("alwaysinline")
        _Body(self.module, function, source)
        return function


# machine code -------------------------------------------------------------------------------------------------------

_LOADED: dict[str, tuple[int, Any]] = {}


def load(text: str, assemble: Callable[[str], str] = assembly) -> int:
    """Address of the compiled kernel, from the cache of object files or compiled now.

    assemble: gives the LLVM code of the text; the text is what tells kernels apart.
    """
    if text not in _LOADED:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        features = llvm.get_host_cpu_features().flatten()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(), features=features, opt=3, jit=True
        )
        name = hashlib.sha256(f"{text}{llvm.get_host_cpu_name()}{features}".encode()).hexdigest()[:24]
        path = cache_folder() / f"kernel_{name}.o"
        if not path.exists():
            with replacing(path) as temporary:
                temporary.write_bytes(_object(assemble(text), machine))
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        engine.add_object_file(llvm.ObjectFileRef.from_path(str(path)))
        engine.finalize_object()
        _LOADED[text] = engine.get_function_address("kernel"), engine
    return _LOADED[text][0]


def _object(code: str, machine: Any) -> bytes:
    """Optimised object code of the module."""
    module = llvm.parse_assembly(code)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))
