"""What a large system costs is said before it is paid."""

import pytest
from tcbench_plugins.net.net import net

import tcbench
from tcbench import progress
from tcbench.solver import foresight, implicit_step


def test_what_does_not_fit_into_memory_is_one_sentence(monkeypatch):
    implicit_step._compiled_flows.cache_clear()
    monkeypatch.setattr(foresight, "_memory", lambda: 1.0)
    with pytest.raises(tcbench.TcbenchError, match="element by element, and this machine has 0: a smaller one is need"):
        tcbench.simulate("tc_monolithic", net(9, 8), t_end=0.1)
    cure = r"as a whole, .* declare its elements \(tcbench.Network"
    with pytest.raises(tcbench.TcbenchError, match=cure), foresight.foreseen(net(9, 8).model, 1, by_loops=False):
        pass


def test_a_long_trace_says_how_long_while_it_lasts():
    with progress.waiting("a run", show=True) as meter, foresight.foreseen(net(20, 20).model, 1, by_loops=False):
        assert meter.text == "a run: tracing 2362 numbers as a whole, about 17 s"
    assert meter.text == "a run"
    with progress.waiting("a run", show=True) as meter, foresight.foreseen(net(20, 20).model, 1, by_loops=True):
        assert meter.text == "a run"


def test_a_run_of_a_large_system_says_how_far_it_is():
    seen = []
    with progress.waiting("a run", show=True) as meter:
        line, meter.line = meter.line, lambda: seen.append((meter.done, meter.total)) or line()
        from tcbench.simulation import run as module

        chunk, module.CHUNK = module.CHUNK, 100
        try:
            march = module.LOOPS.march
            module.LOOPS.__dict__["march"] = lambda *a: (meter.line(), march(*a))[1]
            found = tcbench.simulate("tc_monolithic", net(5, 5), dt=0.1, t_end=4.0)
        finally:
            module.CHUNK = chunk
            module.LOOPS.__dict__["march"] = march
    whole = tcbench.simulate("tc_monolithic", net(5, 5), dt=0.1, t_end=4.0)
    assert found.ok and (found.z == whole.z).all() and len(seen) > 2
    assert seen[-1][1] == 40 and 0 < seen[-1][0] < 40
