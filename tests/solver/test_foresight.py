"""What a large system costs is said before it is paid."""

import importlib
import os
import signal
from threading import Timer
from types import SimpleNamespace

import numpy as np
import pytest
from tcbench_plugins.net.net import net

import tcbench
from tcbench import progress
from tcbench.compiler.caches import Spares
from tcbench.errors import MachineError
from tcbench.plugins import find_integrator, find_scenario
from tcbench.runner import plan as planning
from tcbench.runner.worker import measure_cell
from tcbench.simulation import python_loop
from tcbench.simulation import run as run_module
from tcbench.solver import array_flow, foresight, implicit_step


def test_what_does_not_fit_into_memory_is_one_sentence(monkeypatch):
    implicit_step._compiled_flows.cache_clear()
    monkeypatch.setattr(foresight, "memory", lambda: 1.0)
    sentence = "needs about 0.002 GiB to be traced element by element, and there are 0.00098 GiB: a smaller one is need"
    with pytest.raises(MachineError, match=sentence):
        tcbench.simulate("tc_monolithic", net(9, 8), t_end=0.1)
    cure = r"as a whole, .* declare its spaces \(docs/add-system.md"
    with pytest.raises(MachineError, match=cure), foresight.foreseen(net(9, 8).model, 1, by_loops=False):
        pass


def test_a_jacobian_of_many_terms_is_refused_before_it_is_made(monkeypatch):
    """Eight points of a hexahedron have 1,093 terms, of which numbers of a state say nothing."""
    solid = pytest.importorskip("tcbench_plugins.continua.solid").solid
    pytest.importorskip("skfem")
    scenario = solid(2, "hex")
    monkeypatch.setattr(array_flow, "scattered", lambda *_: pytest.fail("it was made"))
    monkeypatch.setattr(foresight, "memory", lambda: 5.0)
    with pytest.raises(
        MachineError, match=r"unknowns needs about .* GiB for its Jacobian, and there are .* fewer points"
    ):
        tcbench.simulate("tc_monolithic", scenario, t_end=0.1)


def test_a_long_trace_says_how_long_while_it_lasts():
    with progress.waiting("a run", show=True) as meter, foresight.foreseen(net(6, 6).model, 1, by_loops=False):
        assert meter.text == "a run: tracing 206 numbers as a whole, about 3 s"
    assert meter.text == "a run"
    with progress.waiting("a run", show=True) as meter, foresight.foreseen(net(20, 20).model, 1, by_loops=True):
        assert meter.text == "a run"


def test_a_run_of_a_large_system_says_how_far_it_is():
    seen = []
    with progress.waiting("a run", show=True) as meter:
        line, meter.line = meter.line, lambda: seen.append((meter.done, meter.total)) or line()
        chunk, run_module.CHUNK = run_module.CHUNK, 100
        try:
            march = run_module.LOOPS.march
            run_module.LOOPS.__dict__["march"] = lambda *a: (meter.line(), march(*a))[1]
            found = tcbench.simulate("tc_monolithic", net(5, 5), dt=0.1, t_end=4.0)
        finally:
            run_module.CHUNK = chunk
            run_module.LOOPS.__dict__["march"] = march
    whole = tcbench.simulate("tc_monolithic", net(5, 5), dt=0.1, t_end=4.0)
    assert found.ok and (found.z == whole.z).all() and len(seen) > 2
    assert seen[-1][1] == 40 and 0 < seen[-1][0] < 40


def test_memory_is_the_least_of_what_may_be_used(monkeypatch, tmp_path):
    whole = foresight.memory()
    assert whole is None or whole > 100
    for text, expected in (("67108864\n", 64.0), ("max\n", whole)):
        (tmp_path / "limit").write_text(text)
        monkeypatch.setattr(foresight, "CGROUP", (str(tmp_path / "limit"), str(tmp_path / "absent")))
        assert expected is None or foresight.memory() == pytest.approx(expected, rel=0.01) or expected == whole


def test_a_run_beyond_its_time_limit_is_one_sentence_before_it_begins(monkeypatch):
    monkeypatch.setattr(foresight, "time", SimpleNamespace(monotonic=lambda: 0.0))  # a clock that stands still
    names = [[name] for name in ("tc_monolithic", "net[nx=20,ny=20]", "conservation")]
    job = planning.plan_job(*names, dt=[0.0005, 0.2])  # 50,000 steps, and 125
    context = job.context | {"timeout": 3.0}
    long, short = (cell.as_dict() for cell in sorted(job.cells, key=lambda cell: cell.options["dt"]))
    sentence = (
        r"50000 steps of about [\d.]+ ms of a net of 2362 numbers takes about \d+ s, and 3 s are left of the 3 s that "
        r"a cell has: give a longer --timeout, or take fewer steps \(a longer dt, a shorter t_end\) or a smaller system"
    )
    with monkeypatch.context() as patched, pytest.raises(MachineError, match=sentence):  # again when there is more time
        patched.setitem(run_module.LOOPS.__dict__, "march", None)
        measure_cell(long, context)
    assert measure_cell(short, context)["status"] == "ok"
    model, cure = net(20, 20).model, r"Tracing a net .* or declare its spaces"
    with foresight.within(1.0), pytest.raises(MachineError, match=cure), foresight.foreseen(model, 1, by_loops=False):
        pass
    with foresight.within(None), foresight.foreseen(model, 1, by_loops=False):
        pass


@pytest.mark.parametrize(("each", "status"), [(0.5, None), (1e-6, "ok")])
def test_a_run_of_a_method_with_a_loop_of_its_own_is_foreseen_from_its_first_steps(each, status, monkeypatch):
    """Whatever the method: series take a thirtieth of the time of collocation."""
    worked = []

    def march(z, h, count, system):
        worked.extend([each] * count)
        return np.zeros((count, len(z)))

    method = tcbench.Integrator(
        name="still", order=1, step=lambda z, h, system: march(z, h, 1, system)[0], march=march, increments=True
    )
    clocks = SimpleNamespace(thread_time=lambda: sum(worked), perf_counter=lambda: sum(worked), monotonic=lambda: 0.0)
    for module in (python_loop, foresight):
        monkeypatch.setattr(module, "time", clocks)
    with foresight.within(1.0):
        if status:
            assert tcbench.simulate(method, net(20, 20), dt=0.1, t_end=100.0).status == status
            return
        with pytest.raises(MachineError, match=r"1000 steps of about 5e\+02 ms of a net .* 500 s"):
            tcbench.simulate(method, net(20, 20), dt=0.1, t_end=100.0)
    assert len(worked) < 50


PAIRS = [
    ("tc_gauss_adaptive", "net[nx=9,ny=8]"),
    ("tc_taylor", "net[nx=9,ny=8]"),
    ("tc_auto", "heavy_top"),
    ("tc_gauss_adaptive", "heavy_top"),
    ("tc_taylor", "short_term"),
]  # loops over spaces, any system, elements


def looked_at_often(monkeypatch):
    """Runs are looked at, and say something, at each of their steps; returns the times at which they do."""
    seen, tell = [], foresight.Looks.tell
    monkeypatch.setattr(foresight, "FIRST", 0.0)
    monkeypatch.setattr(foresight, "AIM", 0.0)
    monkeypatch.setattr(foresight, "LOOK", -1.0)
    monkeypatch.setattr(foresight.Looks, "tell", lambda looks, t, now: seen.append(t) or tell(looks, t, now))
    for module in ("tc_gauss", "tc_taylor", "tc_auto"):  # what was made before is not looked at so
        found = importlib.import_module(f"tcbench_plugins.{module}")
        for spares in (x for x in vars(found).values() if isinstance(x, Spares)):
            monkeypatch.setattr(spares, "free", {})
    return seen


@pytest.mark.parametrize(("method", "name"), PAIRS)
def test_an_interrupt_ends_a_run_that_chooses_its_steps(name, method):
    """One that would last for hours, in the main thread; the next run is as if nothing had been."""
    solve, scenario = find_integrator(method).adaptive, find_scenario(name)
    if name == "heavy_top":
        scenario = scenario.replace(friction=0.0)  # which would come to rest
    whole, _ = solve(scenario.model, scenario.z0, np.array([0.0, 0.1]), 1e-6, 1e-6)
    keys = Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        keys.start()
        solve(scenario.model, scenario.z0, np.array([0.0, 1e9]), 1e-6, 1e-6)
    keys.join()
    again, _ = solve(scenario.model, scenario.z0, np.array([0.0, 0.1]), 1e-6, 1e-6)
    assert np.array_equal(whole, again)


@pytest.mark.parametrize(("method", "name"), PAIRS)
def test_a_run_that_is_looked_at_takes_the_same_steps_and_says_how_far_it_is(name, method, monkeypatch):
    scenario = find_scenario(name)
    whole = tcbench.simulate(method, scenario, tolerance=1e-6, t_end=6.0)
    seen = looked_at_often(monkeypatch)
    with progress.waiting("a run", show=True) as meter:
        again = tcbench.simulate(method, scenario, tolerance=1e-6, t_end=6.0)
        assert meter.text == "a run" and meter.total is None  # as before
    assert np.array_equal(whole.z, again.z) and len(seen) > 2
    assert seen == sorted(seen) and 0.0 < seen[-1] < 6.0


def test_the_rest_of_a_run_that_chooses_its_steps_is_told():
    looks = foresight.Looks(100)
    looks.begun, looks.times = 1.0, np.linspace(0.0, 100.0, 11)
    with progress.waiting("a run", show=True) as meter:
        looks.tell(0.4, 2.0)
        assert meter.text == "a run"
        looks.tell(20.0, 6.0)
        assert meter.text == "a run, from t = 20 to 100 about 20 s" and (meter.done, meter.total) == (2, 10)
        looks.end()
