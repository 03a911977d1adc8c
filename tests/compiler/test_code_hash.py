"""The hash of what code computes: everything that the code can see changes it, and nothing else does."""

import importlib
import os
import subprocess
import sys
import textwrap
import threading
import types

import numpy as np
import pytest

import tcbench
from tcbench.compiler.formula_hash import formula_hash


def module(text, name="made", **values):
    """A module of a user's own, run from text, in which `f` is what is hashed."""
    made = types.ModuleType(name)
    made.__dict__.update(values)
    exec(compile(textwrap.dedent(text), "<text>", "exec"), made.__dict__)
    return made


DATA = """
import dataclasses
@dataclasses.dataclass
class C:
    a: float = 1.0
    c: dict = dataclasses.field(default_factory=dict, compare=False)
"""
MASKED = "import numpy as n\n"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("def f(x): return x + 1", "def f(x): return x + 2"),
        ("def f(x): return x + 1", "def f(x): return x + 1.0"),
        ("def f(x): return x + 0.0", "def f(x): return x + -0.0"),
        ("def f(x, a=1): return a", "def f(x, a=2): return a"),
        ("def f(x, *, a=1): return a", "def f(x, *, a=2): return a"),
        ("def f(x): return x.cos", "def f(x): return x.sin"),
        ("A = 1.0\ndef f(x): return A", "A = 2.0\ndef f(x): return A"),
        ("A = [1, [2]]\ndef f(x): return A", "A = [1, [3]]\ndef f(x): return A"),
        ("A = {1: 'a'}\ndef f(x): return A", "A = {1: 'b'}\ndef f(x): return A"),
        ("A = {1, 2}\ndef f(x): return A", "A = {1, 3}\ndef f(x): return A"),
        ("def g(x): return 1\ndef f(x): return g(x)", "def g(x): return 2\ndef f(x): return g(x)"),
        ("def f(x): return [y * 1 for y in x]", "def f(x): return [y * 2 for y in x]"),
        ("A = 1\ndef f(x): return (lambda: A)()", "A = 2\ndef f(x): return (lambda: A)()"),
        ("def m(a):\n return lambda x: a\nf = m(1)", "def m(a):\n return lambda x: a\nf = m(2)"),
        ("class C:\n a = 1\ndef f(x): return C.a", "class C:\n a = 2\ndef f(x): return C.a"),
        ("class C:\n def g(s): return 1\nf = C().g", "class C:\n def g(s): return 2\nf = C().g"),
        ("class B: a = 1\nclass f(B): pass", "class B: a = 2\nclass f(B): pass"),
        ("class C: pass\nf = C()\nf.a = 1", "class C: pass\nf = C()\nf.a = 2"),
        ("class C:\n __slots__ = ('a',)\nf = C()\nf.a = 1", "class C:\n __slots__ = ('a',)\nf = C()\nf.a = 2"),
        ("import numpy as n\nA = n.ones(3)\ndef f(): return A", "import numpy as n\nA = n.zeros(3)\ndef f(): return A"),
        ("import numpy as np\ndef f(x): return np.sin(x)", "import numpy as np\ndef f(x): return np.cos(x)"),
        ("import functools\nf = functools.partial(max, 1)", "import functools\nf = functools.partial(max, 2)"),
        ("import functools as t\n@t.cache\ndef f(x): return 1", "import functools as t\n@t.cache\ndef f(x): return 2"),
        ("import enum\nf = enum.Enum('E', 'a b').a", "import enum\nf = enum.Enum('E', 'a b').b"),
        ("class L(list): pass\nf = L([1])", "class L(list): pass\nf = L([2])"),
        ("class D(dict): pass\nf = D(a=1)", "class D(dict): pass\nf = D(a=2)"),
        ("import fractions\nf = fractions.Fraction(1, 3)", "import fractions\nf = fractions.Fraction(2, 3)"),
        (f"{DATA}f = C()\nf.c['x'] = 1", f"{DATA}f = C()\nf.c['x'] = 2"),
        (f"{DATA}f = C()\nf.more = 1", f"{DATA}f = C()\nf.more = 2"),
        (f"{MASKED}f = n.ma.array([1, 2], mask=[False, False])", f"{MASKED}f = n.ma.array([1, 2], mask=[False, True])"),
        (f"{MASKED}class N(n.ndarray): pass\nf = n.ones(2).view(N)\nf.a = 1",
         f"{MASKED}class N(n.ndarray): pass\nf = n.ones(3).view(N)\nf.a = 1"),
    ],
)  # fmt: skip
def test_what_code_sees_is_in_its_hash(before, after):
    first, again, other = (formula_hash(module(text).f) for text in (before, before, after))
    assert first == again and first is not None
    assert other != first


@pytest.mark.parametrize(
    "same",
    [
        "# a comment\n\n\ndef f(x): return x + A\nA = 1",
        "def f(x):\n    return x + A\nA = 1\nB = 7",
        "A = 2 - 1\ndef f(x): return x + A",
    ],
)
def test_what_code_does_not_see_is_not(same):
    assert formula_hash(module(same).f) == formula_hash(module("A = 1\ndef f(x): return x + A").f)


@pytest.mark.parametrize(
    "text",
    [
        "def f(x): return eval('x')",
        "def f(x): return open('numbers').read()",
        "A = (i for i in range(3))\ndef f(x): return next(A)",
        "import threading\nA = threading.Lock()\ndef f(x): return A",
        "class Odd:\n def __reduce_ex__(self, p): raise RuntimeError('no')\nA = Odd()\ndef f(x): return A",
        "A = []\nfor _ in range(5000): A = [A]\ndef f(x): return A",
    ],
)
def test_what_cannot_be_described_has_no_hash(text):
    assert formula_hash(module(text).f) is None
    assert formula_hash(threading.current_thread()) is None


def test_cycles_end():
    text = "A = [{}]\nA[0]['me'] = A\ndef f(x): return g(A)\ndef g(x): return f(x)"
    assert formula_hash(module(text).f) == formula_hash(module(text).f) is not None


def test_an_imported_module_counts_by_the_attributes_that_are_read(tmp_path, monkeypatch):
    (tmp_path / "coefficients_of_mine.py").write_text("def theta(): return INNER\nINNER = 0.5\nUNUSED = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    outside = module("import coefficients_of_mine as c\ndef f(x): return c.theta() * x").f
    inside = module("def f(x):\n    from coefficients_of_mine import theta\n    return theta() * x").f
    assert formula_hash(inside) is None  # what is imported when a formula runs is traced each time
    before = formula_hash(outside)
    loaded = importlib.import_module("coefficients_of_mine")
    loaded.UNUSED = 2
    assert formula_hash(outside) == before is not None
    loaded.INNER = 1.0
    assert formula_hash(outside) != before
    by_name = module("import coefficients_of_mine as c\ndef f(x): return getattr(c, x)").f
    before = formula_hash(by_name)
    loaded.UNUSED = 3
    assert formula_hash(by_name) != before


def test_the_hash_is_the_same_in_another_process():
    script = textwrap.dedent("""
        import numpy as np
        from tcbench import ElementSystem
        from tcbench.compiler.formula_hash import formula_hash
        class Mine(ElementSystem):
            kinds = frozenset({"a", "b", "c", "d"})
            def shape(self, q): return np.array([q @ q, {"x", "y"} and A])
        A = {"one": 1.0, "two": {3, 4}}
        def made():
            class Local:
                def set(self): self.a, self.b, self.c, self.d = 1, 2, 3, 4
            return Local
        one = lambda z: z in {"p", "q", "r", "s"}
        print(formula_hash(Mine, made, one))
    """)
    found = set()
    for seed in "12":  # of the order of sets
        env = os.environ | {"PYTHONHASHSEED": seed}
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=env, check=True)
        found.add(done.stdout)
    assert len(found) == 1 and len(found.pop().strip()) == 64


READING = {
    "a file": "import pathlib\ndef f(x): return x * float(pathlib.Path('k').read_text())",
    "a path that is a global": "import pathlib\nK = pathlib.Path('k')\ndef f(x): return x * float(K.read_text())",
    "a name of pathlib": "from pathlib import Path\ndef f(x): return x * float(Path('k').read_text())",
    "numpy's files": "import numpy as np\ndef f(x): return x * np.loadtxt('k')",
    "a name of numpy": "from numpy import loadtxt\ndef f(x): return x * loadtxt('k')",
    "chance": "import numpy as np\ndef f(x): return x * np.random.rand()",
    "the environment": "import os\ndef f(x): return x * float(os.environ['K'])",
    "a name of os": "from os import environ\ndef f(x): return x * float(environ['K'])",
    "io": "import io\ndef f(x): return x * float(io.open('k').read())",
    "the clock": "from time import time\ndef f(x): return x * time()",
    "an import inside": "def f(x):\n    import os\n    return x * float(os.getenv('K'))",
    "a helper": "import os\ndef f(x): return g(x)\ndef g(x): return x * float(os.getenv('K'))",
    "decimal's context": "from decimal import Decimal\ndef f(x): return x * float(Decimal(1) / 3)",
    "computed names": "from operator import attrgetter\nimport numpy as np\ndef f(x): return attrgetter('pi')(np) * x",
}


@pytest.mark.parametrize("what", READING)
def test_a_formula_that_reads_more_than_its_hash_covers_has_none(what):
    assert formula_hash(module(READING[what]).f) is None


def test_formulas_of_numbers_have_a_hash():
    text = "import numpy as np, math\nfrom scipy.linalg import expm\nA = np.eye(2)\n"
    text += "def f(z): return A @ z * math.pi + g(z)\n"
    assert formula_hash(module(text + "def g(z): return expm(np.zeros(2)) @ np.exp(z)").f) is not None
    assert formula_hash(tcbench.Pendulum) is not None
    for method in ("tc_monolithic", "tc_strang", "tc_gonzalez", "midpoint_entropy"):
        assert None not in [formula_hash(flow.residual) for flow in tcbench.integrators()[method].flows]


def test_a_formula_that_reads_a_file_is_traced_with_what_the_file_says_now(tmp_path):
    """`simulate` went on with what it had said the first time."""
    path = tmp_path / "factor"

    def step(z0, z1, h, system):
        return z1 - z0 - h * float(path.read_text()) * system.vector_field(z0)

    method, ends = tcbench.Integrator(name="reads", order=1, flows=step), []
    for factor in ("1.0", "0.0", "1.0"):
        path.write_text(factor)
        ends.append(tcbench.simulate(method, "short_term", dt=0.1, t_end=0.1).z[-1])
    assert np.array_equal(ends[0], ends[2]) and np.array_equal(ends[1], tcbench.scenarios()["short_term"].z0)
    assert not np.array_equal(ends[0], ends[1])
