"""Kernels without loops, line by line: what `Body` makes of the same text, without a syntax tree of thousands of lines.

Nearly every line reads a number, does one operation or stores a result. The others, calls above all, go the usual way.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from typing import Any

from .statements import Body
from .values import FLOAT, Value, constant

HEAD = "def kernel(a, b, out):\n"
OPERATIONS = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_ITEM = re.compile(r"(a|b|out)\[(\d+)\]\Z")


def head() -> ast.FunctionDef:
    """A kernel that does nothing."""
    (tree,) = ast.parse(HEAD + "    pass").body
    assert isinstance(tree, ast.FunctionDef)
    return tree


def lines_of(text: str) -> list[str] | None:
    """The lines of a kernel that has one block; None of any other text."""
    if not text.startswith(HEAD) or "\n     " in text or "\n#" in text:
        return None
    return [line[4:] for line in text.removeprefix(HEAD).splitlines()]


class Straight(Body):
    """The statements of such a kernel."""

    def __init__(self, module: Any, function: Any, tree: ast.FunctionDef, names: Mapping[str, Any], text: list[str]):
        self.text: list[str] | None = text
        super().__init__(module, function, tree, names, "<kernel>")

    def statements(self, body: Iterable[ast.stmt]) -> None:
        text, self.text = self.text, None
        if text is None:
            super().statements(body)
            return
        for number, line in enumerate(text, 2):
            name, _, value = line.partition(" = ")
            if not (self.stored(name, value) if name.startswith("out[") else self.named(name, value)):
                tree = ast.increment_lineno(ast.parse(line), number - 1)
                self.assigned |= {n.id: 1 for n in ast.walk(tree) if isinstance(n, ast.Name) and _is_set(n)}
                super().statements(tree.body)

    def named(self, name: str, text: str) -> bool:
        """name = a number of an array, or one operation; False, and nothing is done, where it is something else."""
        words = text.split(" ")
        if len(words) == 3 and words[1] in OPERATIONS:
            x, y = self.operand(words[0]), self.operand(words[2])
            code = f"{OPERATIONS[words[1]]} {self.function.fused} double {x}, {y}" if x and y else ""
        elif len(words) > 1:
            return False
        elif item := _ITEM.match(text):
            code = f"load double, ptr {self.item(item)}, align 8"
        else:
            x = self.operand(text[1:]) if text[:2] in ("-t", "-d") else ""
            code = f"fneg double {x}" if x else ""
        if code:
            self.assigned[name] = 1
            self.values[name] = Value(FLOAT, (self.emit(code),))
            self.known.add(name)
        return bool(code)

    def stored(self, place: str, text: str) -> bool:
        """out[i] = a number."""
        value, item = self.operand(text), _ITEM.match(place)
        if not value or not item:
            return False
        self.lines.append(f"  store double {value}, ptr {self.item(item)}, align 8")
        return True

    def item(self, item: re.Match[str]) -> str:
        array, index = item.groups()
        return f"%{array}0" if index == "0" else self.emit(f"getelementptr double, ptr %{array}0, i64 {index}")

    def operand(self, word: str) -> str:
        """LLVM's word for a name or a constant; "" of anything else."""
        known = self.values.get(word)
        if known is not None:
            return str(known.parts[0]) if known.kind == FLOAT else ""
        digits = word[1:-1] if word.startswith("(-") else word
        try:
            return constant(float(digits)) if "." in digits or "e" in digits else ""
        except ValueError:
            return ""


def _is_set(name: ast.Name) -> bool:
    return isinstance(name.ctx, ast.Store)
