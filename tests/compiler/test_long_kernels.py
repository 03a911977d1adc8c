"""How long kernels become machine code, and what is said of one that does not."""

import gc

import numpy as np
import pytest

import tcbench
from tcbench.compiler import kernels, language, machine, once
from tcbench.compiler.kernels import _code
from tcbench.compiler.values import TranslationError
from tcbench.solver.flow_kernels import build

pytestmark = pytest.mark.skipif(language.PLAIN, reason="nothing is translated")


def test_what_is_not_translated_is_refused_with_its_line():
    for line, why in (("t1 = t0 ** 0.5 + c", "'c' is not known"), ("t1 = t0 + t9", "'t9' is not known")):
        with pytest.raises(TranslationError, match=rf"line 3, in kernel\(\): .*{why}"):
            _code(f"def kernel(a, b, out):\n    t0 = a[0]\n    {line}\n    out[0] = t1\n")


def test_a_long_kernel_is_written_quickly_and_gives_the_same(monkeypatch):
    flow = tcbench.integrators()["tc_monolithic"].flows[0]
    monkeypatch.setattr(machine, "LONG", 100)
    text = build(flow, tcbench.scenarios()["short_term"].model).iterate.text
    code, levels = _code(text), []
    assert code.count("\n") > machine.LONG
    make, _ = machine._machine, machine._compiler()
    monkeypatch.setattr(machine, "_machine", lambda level=3: levels.append(level) or make(level))
    found = machine.compile_object(code, machine.LINE)
    monkeypatch.setattr(machine, "LONG", 10**9)
    usual = machine.compile_object(code, machine.LINE)
    assert levels == [1, 3] and abs(len(found) - len(usual)) < 0.02 * len(usual)
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
    with trace.tracing(), once.uncollected():
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
