"""Statements of the restricted Python as LLVM code. See `translator`."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from .arithmetic import handler
from .expressions import Expressions
from .values import FLOAT, IN_MEMORY, INT, NOTHING, Array, RowsOf, Several, TranslationError, Value, machine_kinds, say


def _targets(node: ast.AST) -> Iterable[str]:
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Tuple):
        for part in node.elts:
            yield from _targets(part)


def _all_statements(body: Iterable[ast.stmt]) -> Iterable[ast.stmt]:
    """The statements of a body and of the bodies in it, expressions left out."""
    for node in body:
        yield node
        if not isinstance(node, ast.Assign):
            for inner in ("body", "orelse"):
                yield from _all_statements(getattr(node, inner, ()))


def _assignments(tree: ast.FunctionDef) -> dict[str, int]:
    """The number of assignments to each local name; an argument is one."""
    counts = {a.arg: 1 for a in tree.args.args}
    for node in _all_statements(tree.body):
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AugAssign | ast.AnnAssign | ast.For):
            targets = [node.target]
        for name in (n for t in targets for n in _targets(t)):
            counts[name] = counts.get(name, 0) + 1
    return counts


@dataclass
class _Loop:
    head: str
    end: str
    ways_out: list[set[str]]


class Body(Expressions):
    """The statements of one function."""

    def __init__(self, module: Any, function: Any, tree: ast.FunctionDef, names: Mapping[str, Any], file: str) -> None:
        self.module, self.function, self.names, self.file = module, function, names, file
        self.allocations: list[str] = []
        self.lines, self.values, self.cells = [], {}, {}
        self.assigned, self.definite, self.block = _assignments(tree), set(), "entry"
        self.is_open, self.loops = True, list[_Loop]()
        arguments = tree.args
        if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.posonlyargs or arguments.defaults:
            raise self.refusal(tree, "a function has arguments by position, without defaults")
        for argument in tree.args.args:
            kind = function.arguments[argument.arg]
            if kind is None or kind == NOTHING or isinstance(kind, Several):
                raise self.refusal(
                    argument, "an argument is annotated int, float, bool, Floats, Matrix, ... or a Record"
                )
            parts = tuple(f"%{argument.arg}{i}" for i in range(len(machine_kinds(kind))))
            self.keep(argument, argument.arg, Value(kind, parts))
        if function.result is None or isinstance(function.result, Array | RowsOf | type):
            raise self.refusal(
                tree, "a function is annotated with what it returns: None, int, float, bool or a tuple of these"
            )
        self.statements(tree.body)
        if self.is_open:
            if function.result != NOTHING:
                raise self.refusal(tree, "the function can run off its end without a result")
            self.lines.append("  ret void")

    def refusal(self, node: ast.AST, why: str) -> TranslationError:
        text = ast.unparse(node).splitlines()[0] if not isinstance(node, ast.arg) else node.arg
        line = getattr(node, "lineno", 0)
        return TranslationError(f"{self.file}, line {line}, in {self.function.title}: {text!r}: {why}.")

    def statements(self, body: Iterable[ast.stmt]) -> None:
        for node in body:
            if not self.is_open:
                raise self.refusal(node, "this is never reached")
            method = getattr(self, f"{handler(type(node).__name__)}_statement", None)
            if method is None:
                raise self.refusal(node, "this kind of statement is not translated")
            method(node)

    def jump(self, label: str) -> None:
        self.lines.append(f"  br label %{label}")
        self.is_open = False

    def arrive(self, label: str, definite: set[str]) -> None:
        self.start_block(label)
        self.is_open, self.definite = True, set(definite)

    # names ----------------------------------------------------------------------------------------------------------

    def keep(self, node: ast.AST, name: str, value: Value) -> None:
        """name = value."""
        if value.kind == NOTHING or isinstance(value.kind, Several):
            raise self.refusal(node, f"{say(value.kind)} has no name of its own: unpack it")
        if self.assigned[name] == 1:
            self.values[name] = value
        else:
            if name not in self.cells:
                kinds = machine_kinds(value.kind)
                places = tuple(f"%{name}.{i}" for i in range(len(kinds)))
                self.allocations += [f"  {p} = alloca {k}" for p, k in zip(places, kinds, strict=True)]
                self.cells[name] = Value(value.kind, places)
            cell = self.cells[name]
            if cell.kind == FLOAT and value.kind == INT:
                value = Value(FLOAT, (self.convert(node, value, FLOAT),))
            if cell.kind != value.kind:
                raise self.refusal(node, f"{name!r} is {say(cell.kind)} above and {say(value.kind)} here")
            for i, kind in enumerate(machine_kinds(cell.kind)):
                self.lines.append(f"  store {kind} {self.part(value, i)}, ptr {cell.parts[i]}")
        self.definite.add(name)

    def store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self.keep(target, target.id, value)
        elif isinstance(target, ast.Subscript):
            place = self.place(target)
            if not isinstance(place.kind, str):
                raise self.refusal(target, "a whole array is filled by copy_into or fill")
            self._put(target, place, value)
        elif isinstance(target, ast.Attribute) and self.is_local(target):
            self._store_field(target, value)
        else:
            raise self.refusal(target, "this cannot be assigned to")

    def _put(self, node: ast.AST, place: Value, value: Value) -> None:
        """Store a number in an array."""
        kind, _, narrows = IN_MEMORY.get(place.kind, (place.kind, "", ""))
        code = self.convert(node, value, kind)
        if narrows:
            code = self.emit(f"{narrows} {kind} {code} to {place.kind}")
        self.lines.append(f"  store {place.kind} {code}, ptr {self.part(place)}, align {4 if narrows else 8}")

    def _store_field(self, target: ast.Attribute, value: Value) -> None:
        owner = self.value(target.value)
        fields = owner.kind.fields if isinstance(owner.kind, type) else {}  # type: ignore[attr-defined]
        field = fields.get(target.attr)
        if field is None or not owner.kind.mutable or field.kind not in ("int", "float", "bool"):
            raise self.refusal(target, "only numbers of a record with mutable=True can be assigned to")
        kind = FLOAT if field.kind == "float" else INT
        code = self.convert(target, value, kind)
        self.lines.append(f"  store {kind} {code}, ptr {self.field_place(owner, field)}")

    # statements -----------------------------------------------------------------------------------------------------

    def _assign_statement(self, node: ast.Assign) -> None:
        if len(node.targets) != 1:
            value = self.value(node.value)
            for target in node.targets:
                self.store(target, value)
            return
        target = node.targets[0]
        if not isinstance(target, ast.Tuple):
            self.store(target, self.value(node.value))
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.value(x) for x in node.value.elts]
        else:
            results = self.value(node.value)
            kinds = results.kind.kinds if isinstance(results.kind, Several) else ()
            values = [Value(kind, (code,)) for kind, code in zip(kinds, results.parts, strict=True)] if kinds else []
        if len(values) != len(target.elts):
            raise self.refusal(node, f"{len(values)} values for {len(target.elts)} names")
        for part, value in zip(target.elts, values, strict=True):
            self.store(part, value)

    def _annassign_statement(self, node: ast.AnnAssign) -> None:
        assert node.value is not None
        self.store(node.target, self.value(node.value))

    def _augassign_statement(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Subscript):  # evaluate the place once
            place = self.place(node.target)
            if not isinstance(place.kind, str):
                raise self.refusal(node, "arithmetic of whole arrays is not translated: write the loop")
            place = place._replace(parts=(self.part(place),))
            self._put(node, place, self.binary(node, node.op, self.loaded(place), self.value(node.value)))
            return
        old = self.value(node.target)
        if isinstance(node.target, ast.Name) and not isinstance(old.kind, str):
            raise self.refusal(node, "arithmetic of whole arrays is not translated: write the loop")
        self.store(node.target, self.binary(node, node.op, old, self.value(node.value)))

    def _expr_statement(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            if not isinstance(node.value, ast.Call):
                raise self.refusal(node, "a value that nothing becomes of")
            self.value(node.value)

    def _pass_statement(self, node: ast.Pass) -> None:
        pass

    def _return_statement(self, node: ast.Return) -> None:
        result = self.function.result
        if result == NOTHING:
            if node.value is not None:
                raise self.refusal(node, "a function that returns None has no result")
            self.lines.append("  ret void")
        elif node.value is None:
            raise self.refusal(node, "a result is needed")
        else:
            value = self.value(node.value)
            if isinstance(result, Several):
                kinds = value.kind.kinds if isinstance(value.kind, Several) else ()
                if len(kinds) != len(result.kinds):
                    raise self.refusal(node, f"{len(result.kinds)} results are annotated")
                whole = "undef"
                for i, (kind, wanted) in enumerate(zip(kinds, result.kinds, strict=True)):
                    code = self.convert(node, Value(kind, (value.parts[i],)), wanted)
                    whole = self.emit(f"insertvalue {self.function.result_code} {whole}, {wanted} {code}, {i}")
                self.lines.append(f"  ret {self.function.result_code} {whole}")
            else:
                self.lines.append(f"  ret {result} {self.convert(node, value, result)}")
        self.is_open = False

    def _if_statement(self, node: ast.If) -> None:
        test, (yes, no, join) = self.truth(node.test), [self.label(x) for x in ("then", "else", "after")]
        self.lines.append(f"  br i1 {test}, label %{yes}, label %{no if node.orelse else join}")
        before, ways = self.definite, []
        for body, label in ((node.body, yes), (node.orelse, no)):
            if not body:
                ways.append(before)
                continue
            self.arrive(label, before)
            self.statements(body)
            if self.is_open:
                ways.append(self.definite)
                self.jump(join)
        if ways:
            self.arrive(join, set.intersection(*ways))

    def _while_statement(self, node: ast.While) -> None:
        self._no_else(node)
        head, body, end = (self.label(x) for x in ("while", "body", "end"))
        self.jump(head)
        self.arrive(head, self.definite)
        forever = isinstance(node.test, ast.Constant) and node.test.value is True
        self.lines.append(
            f"  br label %{body}" if forever else f"  br i1 {self.truth(node.test)}, label %{body}, label %{end}"
        )
        loop = _Loop(head, end, [] if forever else [self.definite])
        self._loop(loop, body, node.body)

    def _loop(self, loop: _Loop, label: str, body: list[ast.stmt]) -> None:
        self.loops.append(loop)
        self.arrive(label, self.definite)
        self.statements(body)
        if self.is_open:
            self.jump(loop.head)
        self.loops.pop()
        if loop.ways_out:
            self.arrive(loop.end, set.intersection(*loop.ways_out))

    def _for_statement(self, node: ast.For) -> None:
        self._no_else(node)
        if not (
            isinstance(node.iter, ast.Call) and isinstance(node.iter.func, ast.Name) and node.iter.func.id == "range"
        ):
            raise self.refusal(node.iter, "only range(...) can be gone through")
        if not isinstance(node.target, ast.Name):
            raise self.refusal(node.target, "one name is needed here")
        bounds = [self.number(x, INT)[1] for x in node.iter.args]
        start, stop, step = ("0", *bounds, "1") if len(bounds) == 1 else (*bounds, "1")[:3]
        if not step.lstrip("-").isdigit() or int(step) == 0:
            raise self.refusal(node.iter, "the step of a range must be a constant, not 0")
        head, body, after, end = (self.label(x) for x in ("for", "body", "next", "end"))
        counter = f"%{self.label('counter')}"
        self.allocations.append(f"  {counter} = alloca i64")
        self.lines.append(f"  store i64 {start}, ptr {counter}")
        self.jump(head)
        before = self.definite
        self.arrive(head, before)
        here = self.emit(f"load i64, ptr {counter}")
        test = self.emit(f"icmp {'slt' if int(step) > 0 else 'sgt'} i64 {here}, {stop}")
        self.lines.append(f"  br i1 {test}, label %{body}, label %{end}")
        self.start_block(body)
        self.keep(node.target, node.target.id, Value(INT, (here,)))
        self.loops.append(_Loop(after, end, [before]))
        self.statements(node.body)
        if self.is_open:
            self.jump(after)
        ways = self.loops.pop().ways_out
        self.arrive(after, before)
        following = self.emit(f"add nsw i64 {here}, {step}")
        self.lines.append(f"  store i64 {following}, ptr {counter}")
        self.jump(head)
        self.arrive(end, set.intersection(*ways))

    def _no_else(self, node: ast.While | ast.For) -> None:
        if node.orelse:
            raise self.refusal(node, "else of a loop is not translated")

    def _break_statement(self, node: ast.Break) -> None:
        self.loops[-1].ways_out.append(self.definite)
        self.jump(self.loops[-1].end)

    def _continue_statement(self, node: ast.Continue) -> None:
        self.jump(self.loops[-1].head)
