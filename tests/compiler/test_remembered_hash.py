"""A hash that is kept: it is that of the content at every moment, and what can be watched is not hashed again."""

import functools
import importlib
import sys
import types
from dataclasses import dataclass

import numpy as np
import pytest

import tcbench
from tcbench.compiler import remembered_hash as module
from tcbench.compiler.code_hash import content_hash
from tcbench.compiler.remembered_hash import remembered_hash
from tests.compiler.test_code_hash import module as made

WATCHED = {  # a text that defines f, and an edit that changes what f computes
    "global number": ("A = 1.0\ndef f(x): return A", "A = 2.0"),
    "number of another kind": ("A = 1\ndef f(x): return A", "A = 1.0"),
    "sign of zero": ("A = 0.0\ndef f(x): return A", "A = -0.0"),
    "global that was not there": ("def f(x): return sum(x)", "def sum(x): return 1"),
    "helper": ("def g(x): return 1\ndef f(x): return g(x)", "def g(x): return 2"),
    "global of a helper": ("A = 1\ndef g(x): return A\ndef f(x): return g(x)", "A = 2"),
    "code": ("def f(x): return 1\ndef g(x): return 2", "f.__code__ = g.__code__"),
    "default": ("def f(x, a=1): return a", "f.__defaults__ = (2,)"),
    "keyword default": ("def f(x, *, a=1): return a", "f.__kwdefaults__['a'] = 2"),
    "attribute of a function": ("def f(x): return f.a\nf.a = 1", "f.a = 2"),
    "item of a list": ("A = [1, [2, 3]]\ndef f(x): return A", "A[1][0] = 4"),
    "length of a list": ("A = [1, 2]\ndef f(x): return A", "A.append(3)"),
    "item of a dict": ("A = {'a': [1]}\ndef f(x): return A", "A['a'].append(2)"),
    "array in place": ("import numpy as np\nA = np.ones(3)\ndef f(x): return A", "A[1] = 2.0"),
    "shape of an array": ("import numpy as np\nA = np.ones((2, 3))\ndef f(x): return A", "A.shape = (3, 2)"),
    "cell": ("def m(a):\n def f(x): return a\n return f\nf = m(1)", "f.__closure__[0].cell_contents = 2"),
    "array in a cell": ("import numpy as np\nA = np.ones(2)\ndef m(a): return lambda x: a\nf = m(A)", "A[0] = 3"),
    "function in a cell": ("def m(a): return lambda x: a\ndef g(x): return B\nB = 1\nf = m(g)", "B = 2"),
    "method of a class": ("class f:\n def g(self): return 1", "def h(self): return 2\nf.g = h"),
    "attribute of a class": ("class C: a = 1\ndef f(x): return C.a", "C.a = 2"),
    "attribute of a base": ("class B: a = 1\nclass f(B): pass", "B.a = 2"),
    "base": ("class B: pass\nclass C: a = 1\nclass D(B): pass\ndef f(x): return D()", "D.__bases__ = (C,)"),
    "property": ("A = 1\nclass f:\n @property\n def g(self): return A", "A = 2"),
    "partial": ("import functools\nA = [1]\nf = functools.partial(max, A)", "A[0] = 2"),
    "keyword of a partial": ("import functools\nf = functools.partial(max, key=1)", "f.keywords['key'] = 2"),
    "wrapped": ("import functools as t\nA = 1\n@t.cache\ndef f(x): return A", "A = 2"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "edit"), WATCHED.values(), ids=WATCHED)
def test_an_edit_is_seen_and_nothing_else_is_hashed_again(text, edit, monkeypatch):
    scope = made(text)
    first = remembered_hash(scope.f)
    assert first == content_hash(scope.f) is not None
    monkeypatch.setattr(module, "content_hash", None)
    assert remembered_hash(scope.f) == first
    monkeypatch.undo()
    exec(edit, scope.__dict__)
    second = remembered_hash(scope.f)
    assert second == content_hash(scope.f) != first


@pytest.mark.parametrize(
    ("text", "edit"),
    [
        ("import types\nA = types.SimpleNamespace(a=1)\ndef f(x): return A.a", "A.a = 2"),
        ("class C: pass\nA = C()\nA.a = 1\ndef f(x): return A.a", "A.a = 2"),
        ("A = {1, 2}\ndef f(x): return A", "A.add(3)"),
        ("A = bytearray(b'1')\ndef f(x): return A", "A[0] = 2"),
        ("import numpy as np\nA = np.array([[1], None], dtype=object)\ndef f(x): return A", "A[0].append(2)"),
        ("import numpy as np\nclass N(np.ndarray): pass\nA = np.ones(2).view(N)\ndef f(x): return A", "A[0] = 2"),
        ("A = list(range(2000))\ndef f(x): return A", "A[7] = 0"),
        ("import random\nA = random.Random(1)\ndef f(x): return A", "A.seed(2)"),
    ],
)
def test_what_is_not_watched_is_hashed_each_time(text, edit):
    scope = made(text)
    first = remembered_hash(scope.f)
    assert first == remembered_hash(scope.f) == content_hash(scope.f)
    exec(edit, scope.__dict__)
    assert remembered_hash(scope.f) == content_hash(scope.f) != first


def test_a_module_of_ones_own_is_watched_where_it_is_read(tmp_path, monkeypatch):
    (tmp_path / "weights_to_watch.py").write_text("def mean(): return INNER\nINNER, UNUSED = 0.5, 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    f = made("import weights_to_watch as w\ndef f(x): return w.mean() * w.later").f
    weights = importlib.import_module("weights_to_watch")
    found = [remembered_hash(f)]
    for name, value in (("UNUSED", 2), ("INNER", 1.0), ("later", 3)):
        setattr(weights, name, value)
        found.append(remembered_hash(f))
        assert found[-1] == content_hash(f)
    assert found[0] == found[1] and len(set(found)) == 3
    del sys.modules["weights_to_watch"]


def test_a_dataclass_of_a_user_s_own_is_hashed_each_time():
    @dataclass(frozen=True)
    class Pair:
        one: list
        other: float = 1.0

    pair = Pair([1])
    found = [remembered_hash(pair)]
    pair.one.append(2)
    found.append(remembered_hash(pair))
    object.__setattr__(pair, "other", 2.0)
    found.append(remembered_hash(pair))
    assert len(set(found)) == 3 and found[-1] == content_hash(pair)


def test_a_cell_that_is_not_filled_yet_is_no_error():
    scope = made("""
        def make():
            def f(x): return late
            yield f
            late = 2
            yield f
    """)
    steps = scope.make()
    f = next(steps)
    first = remembered_hash(f)
    assert first == content_hash(f) is not None
    next(steps)
    assert remembered_hash(f) == content_hash(f) != first


def test_an_object_in_the_place_of_another_is_not_taken_for_it():
    found = set()
    for i in range(5000):  # freed and made again at the same addresses; more of them than are kept
        found.add(remembered_hash(made(f"def f(x): return {i % 100}").f))
    assert len(found) == 100 and len(module._KEPT) <= module.MOST_KEPT


def test_formulas_of_a_factory_are_not_hashed_at_every_call(monkeypatch):
    """Closures, defaults, partial functions; of an installed plugin and of ones own."""
    weights = np.array([0.25, 0.75])

    def factory(weights, theta):
        def formula(z0, z1, h, system, scale=1.0):
            at = weights[0] * z0 + weights[1] * z1
            return z1 - z0 - h * scale * system.vector_field(at + theta * (z1 - z0))

        return formula

    def explicit(by, z0, z1, h, system):
        return z1 - z0 - by * h * system.vector_field(z0)

    methods = ["gauss2", "tc_itoh_abe", "tc_strang"]
    own = factory(weights, 0.25), functools.partial(explicit, 1.0), types.MethodType(explicit, 1.0)
    methods += [tcbench.Integrator(name="mine", order=1, flows=formula) for formula in own]
    before = [tcbench.simulate(method, "short_term", 0.01, 0.1).z[-1] for method in methods]
    monkeypatch.setattr(module, "content_hash", None)
    after = [tcbench.simulate(method, "short_term", 0.01, 0.1).z[-1] for method in methods]
    assert all(map(np.array_equal, before, after))
    monkeypatch.undo()
    weights[:] = 0.5
    assert not np.array_equal(tcbench.simulate(methods[3], "short_term", 0.01, 0.1).z[-1], before[3])
