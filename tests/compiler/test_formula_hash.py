"""A hash that is kept is the hash: whatever a formula sees, an edit of it is noticed, and undone it is the old one."""

import functools
import types

import numpy as np
import pytest

from tcbench.compiler.formula_hash import formula_hash

NUMBER, LIST, DICT, ARRAY, MATRIX = 2.0, [1.0, 2.0], {"a": 1}, np.array([1.0, 2.0]), np.zeros((100, 100))
HOME = types.ModuleType("helpers_of_mine")
HOME.rate = 2.0


def helper(z):
    return NUMBER * z


def formula(z):
    return helper(z) + LIST[0] + DICT["a"] + ARRAY[1] + MATRIX[0, 0] + HOME.rate


def wave(z):
    return np.cosh(z)


class Law:
    rate = 1.0

    def energy(self, z):
        return self.rate * helper(z)


def closure(inner):
    def found(z, *, factor=1.0):
        return inner[0] * z * factor

    return found


def counted():
    count = 0

    def found(z):
        return count * z

    def change(value):
        nonlocal count
        count, before = value, count
        return before

    return found, change


INNER = [1.0]
CLOSED = closure(INNER)
COUNTED, SET_COUNT = counted()
PARTIAL = functools.partial(formula, 1.0)


def other(z):
    return -z


def swap(name, value):
    """A change of a global of this file, and its undoing."""

    def change(monkeypatch):
        monkeypatch.setitem(globals(), name, value)

    return change


def put(item, key, value):
    def change(monkeypatch):
        if isinstance(item, np.ndarray | list):
            before = item[key]
            monkeypatch.setitem(UNDO, id(item), lambda: item.__setitem__(key, before))
            item[key] = value
        else:
            monkeypatch.setitem(item, key, value)

    return change


def attribute(item, name, value):
    return lambda monkeypatch: monkeypatch.setattr(item, name, value, raising=False)


UNDO = {}
CHANGES = [
    (formula, swap("NUMBER", 3.0)), (formula, swap("NUMBER", 2)), (formula, swap("helper", other)),
    (formula, put(LIST, 0, 1)), (formula, put(DICT, "a", True)), (formula, put(DICT, "b", 1)),
    (formula, put(ARRAY, 1, 2.5)), (formula, put(MATRIX, (0, 0), 1.0)), (formula, attribute(HOME, "rate", 3.0)),
    (formula, attribute(formula, "__code__", other.__code__)), (formula, attribute(helper, "__defaults__", (1.0,))),
    (helper, attribute(helper, "mark", 1)), (CLOSED, put(INNER, 0, 2.0)),
    (CLOSED, put(CLOSED.__kwdefaults__, "factor", 2.0)), (COUNTED, lambda m: m.setitem(UNDO, 0, SET_COUNT(1) or None)),
    (PARTIAL, put(PARTIAL.keywords, "x", 1.0)), (Law, attribute(Law, "rate", 2.0)), (Law, swap("NUMBER", 3.0)),
    (Law, attribute(Law, "energy", other)), (Law, attribute(Law, "more", 1.0)),
    (wave, attribute(np, "cosh", other)), (wave, attribute(np, "cosh", np.sinh)),  # in the place of numpy's own
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(CHANGES)))
def test_what_a_formula_sees_is_looked_at_again(number, monkeypatch):
    item, change = CHANGES[number]
    before = formula_hash(item)
    assert before is not None and formula_hash(item) == before
    with monkeypatch.context() as undone:
        UNDO.clear()
        change(undone)
        undo = [f for f in UNDO.values() if f]
        after = formula_hash(item)
        assert after not in (None, before) and formula_hash(item) == after
    for f in undo:
        f()
    if item is COUNTED:
        SET_COUNT(0)
    assert formula_hash(item) == before
