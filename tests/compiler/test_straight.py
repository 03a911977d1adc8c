"""Kernels line by line: the LLVM code of the syntax tree, letter for letter; and how long ones become machine code."""

import ast
import gc

import numpy as np
import pytest

import tcbench
from tcbench.compiler import collector, kernels, language, machine, straight
from tcbench.compiler.kernels import _code
from tcbench.compiler.values import TranslationError
from tcbench.solver.flow_kernels import build

pytestmark = pytest.mark.skipif(language.PLAIN, reason="nothing is translated")
LINES = """
t0 = a[0]
t1 = b[3]
t2 = t0 + t1
t3 = 0.5 * t2
t4 = t3 - (-1e-05)
t5 = 1.0 / t4
t6 = -t5
t7 = t6 + (t2 - t2)
t8 = exp(t7)
t9, dt9 = phi_pair(t8)
t10 = max(t9, dt9)
t11 = inf * t10
t12 = 1e+300 * 2.5
t13 = out[2]
t14 = -dt9
t15 = (-2.0)
v0 = vector(t0, t1)
v1 = row(a, 2, 2)
v2 = v0 * v1
v3 = v2 + t3
t16 = v3[1]
put(out, 4, v3)
out[0] = t16
out[1] = 1.0
out[7] = (-2.5)
out[8] = inf
out[9] = t15
"""


def by_tree(text, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(straight, "lines_of", lambda text: None)
        return _code(text)


def kernel_texts():
    """Of methods that have few and many unknowns, explicit flows and both variables."""
    model = tcbench.scenarios()["short_term"].model
    for name in ("tc_monolithic", "midpoint_temperature", "tc_mean_value", "verlet_heat4", "gauss2"):
        for flow in tcbench.integrators()[name].flows:
            found = build(flow, model)
            yield from (k.text for k in (found.setup, found.opening, found.iterate, found.polish, found.full))


def test_every_kind_of_line_is_what_the_tree_makes_of_it(monkeypatch):
    text = straight.HEAD + "".join(f"    {line}\n" for line in LINES.strip().splitlines())
    assert straight.lines_of(text) is not None
    assert _code(text) == by_tree(text, monkeypatch)


def test_kernels_of_methods_are_and_no_tree_of_their_text_is_made(monkeypatch):
    texts = [text for text in kernel_texts() if "out[" in text]
    expected = [by_tree(text, monkeypatch) for text in texts]
    parse, long = ast.parse, []
    monkeypatch.setattr(ast, "parse", lambda text, *rest, **more: long.append(len(text)) or parse(text, *rest, **more))
    assert [_code(text) for text in texts] == expected and len(texts) > 20
    assert max(len(text) for text in texts) > 50_000 and len(long) < sum(text.count("(") for text in texts)


def test_what_is_not_translated_is_refused_with_its_line():
    for line, why in (("t1 = t0 ** 0.5 + c", "'c' is not known"), ("t1 = t0 + t9", "'t9' is not known")):
        with pytest.raises(TranslationError, match=rf"line 3, in kernel\(\): .*{why}"):
            _code(f"{straight.HEAD}    t0 = a[0]\n    {line}\n    out[0] = t1\n")


def test_text_with_loops_goes_the_usual_way(monkeypatch):
    text = straight.HEAD + "    for i in range(3):\n        out[i] = a[i]\n"
    assert straight.lines_of(text) is None and "br label" in _code(text)


def test_a_long_kernel_is_written_quickly_and_gives_the_same(monkeypatch):
    flow = tcbench.integrators()["gauss2"].flows[0]
    text = build(flow, tcbench.scenarios()["short_term"].model).iterate.text
    code, levels = _code(text), []
    assert code.count("\n") > machine.LONG
    make = machine._machine
    monkeypatch.setattr(machine, "_machine", lambda level=3: levels.append(level) or make(level))
    found = machine.compile_object(code, False)
    monkeypatch.setattr(machine, "LONG", 10**9)
    usual = machine.compile_object(code, False)
    assert levels == [3, 1, 3] and abs(len(found) - len(usual)) < 0.02 * len(usual)
    # the same text under two names: values to the last bit
    a, b = np.random.default_rng(0).uniform(0.5, 1.5, (2, 2000))
    results = []
    for long in (0, 10**9):
        monkeypatch.setattr(machine, "LONG", long)
        kernel = kernels.Kernel(f"{text}    out[0] = out[0] + {float(long)!r} * 0.0\n", text.count("out["))
        results.append(kernel(a, b))
    assert np.isfinite(results).all() and np.array_equal(*results)


def test_the_collector_rests_while_something_is_traced_and_only_then():
    from tcbench.compiler import derivatives as trace

    assert gc.isenabled()
    with trace.tracing(), collector.paused():
        assert not gc.isenabled()
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError), trace.tracing():
        1 / 0  # noqa: B018
    assert gc.isenabled()
    gc.disable()
    try:
        with trace.tracing():
            pass
        assert not gc.isenabled()  # as its user has it
    finally:
        gc.enable()
