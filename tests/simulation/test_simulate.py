"""`tcbench.simulate`: its contract, statuses, bad input, and agreement with an independent solver."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import fsolve

import tcbench
from tcbench import Flow, Integrator, TcbenchError
from tcbench.simulation import run as simulation

SCENARIOS = tcbench.scenarios()


def test_a_run_has_the_documented_shapes():
    run = tcbench.simulate("tc_monolithic", "short_term", dt=0.3)
    n = run.steps
    assert n == 84  # 84 * 0.3 = 25.2: the last step ends just past t_end = 25
    assert run.t.shape == run.energy.shape == run.entropy.shape == run.angular_momentum.shape == (n + 1,)
    assert run.z.shape == (n + 1, 10) and run.temperatures.shape == (n + 1, 2)
    assert run.newton_iterations.shape == (n,) and run.newton_iterations.min() >= 1
    assert run.status == "ok" and run.failure == "" and run.wall_time_s > 0
    assert run.t[-1] == pytest.approx(25.2)
    model = SCENARIOS["short_term"].model
    assert np.allclose(run.energy, model.energy(run.z), rtol=1e-15)
    assert np.allclose(run.temperatures, model.temperatures(run.z), rtol=1e-14)


def plain_residual(z1, z0, h, model, method):
    """The appendix formulas written out by hand on floats: no tracing, no elimination, no hoisting."""
    mid, m = (z0 + z1) / 2, model
    if method == "midpoint_entropy":
        return z1 - z0 - h * np.asarray(m.vector_field(mid))
    DE = np.asarray(m.discrete_gradient(z0, z1))
    q = z1[:4] - z0[:4] - h * DE[4:8]
    p = z1[4:8] - z0[4:8] + h * DE[:4]
    a, b = DE[8:]
    return np.concatenate([q, p, z1[8:] - z0[8:] - h * m.conductivity * np.array([b / a - 1, a / b - 1])])


@pytest.mark.parametrize("scenario", ["short_term", "bound_equilibrium"])
@pytest.mark.parametrize("method", ["tc_monolithic", "midpoint_entropy"])
def test_compiled_steps_agree_with_scipy_on_the_formula_written_by_hand(method, scenario):
    scenario = SCENARIOS[scenario]
    run = tcbench.simulate(method, scenario, dt=0.05, t_end=0.25)
    z = scenario.z0.copy()
    for k in range(5):
        z, *_ = fsolve(plain_residual, z, (z.copy(), 0.05, scenario.model, method), xtol=1e-14, full_output=1)
        assert np.allclose(run.z[k + 1], z, rtol=1e-9, atol=1e-9)


PLAIN = """
import tcbench
RUNS = (
    ("tc_strang", "stiff_spring", 0.3, 0.9), ("tc_gauss", "short_term", 0.15, 0.6),
    ("midpoint_entropy", "stiff_spring", 1.5, 6.0), ("tc_monolithic", "stiff_spring", 12.0, 24.0),
    ("midpoint_temperature", "cold_spring", 12.0, 12.0),
)  # Newton, tracking, arcs and folds, a blow-up, a lost branch; of tc_gauss no initial layer, which plain code, without
# vectors, looks for among all variables
LINES = []
for method, scenario, dt, t_end in RUNS:
    r = tcbench.simulate(method, scenario, dt=dt, t_end=t_end)
    s = r.solver
    LINES.append(" ".join(map(str, (r.status, r.steps, s.tracked, s.arcs, s.folds, *(x.hex() for x in r.z[-1])))))
"""


def test_plain_python_gives_what_the_compiled_code_gives():
    env, here = os.environ | {"TCBENCH_PLAIN": "1"}, {}
    exec(PLAIN, here)
    command = [sys.executable, "-c", PLAIN + "print(*LINES, sep='\\n')"]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    found = [[line.split() for line in lines] for lines in (here["LINES"], done.stdout.splitlines())]
    for compiled, plain in zip(*found, strict=True):
        assert compiled[:5] == plain[:5]  # status, steps, and what the solver needed
        a, b = ([float.fromhex(x) for x in line[5:]] for line in (compiled, plain))
        assert np.allclose(a, b, rtol=1e-11, atol=1e-11)  # fused multiply-add rounds differently
    assert {line[0] for line in found[0]} == {"ok", "blowup", "no_root"}
    assert sum(int(line[4]) for line in found[0]) >= 2  # folds


def test_record_every_keeps_the_same_states_and_the_whole_summary():
    every = tcbench.simulate("midpoint_entropy", "short_term")
    some = tcbench.simulate("midpoint_entropy", "short_term", record_every=10)
    ends = tcbench.simulate("midpoint_entropy", "short_term", record_every=None)
    assert np.array_equal(some.z[:-1], every.z[::10]) and np.array_equal(some.z[-1], every.z[-1])
    assert np.allclose(some.t[:-1], every.t[::10]) and some.t[-1] == every.t[-1]
    assert len(ends.t) == 2 and np.array_equal(ends.z[-1], every.z[-1])
    largest = np.abs(every.energy - every.energy[0]).max() / every.scenario.initial_exergy
    assert some.summary.energy_error_max == every.summary.energy_error_max == largest
    assert ends.summary.entropy_increment_min == np.diff(every.entropy).min()
    assert some.newton_iterations.sum() == every.newton_iterations.sum() == ends.solver.newton_iterations


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang", "verlet_heat"])
def test_a_run_in_parts_is_the_same_to_the_last_bit(method, monkeypatch):
    # parts of odd lengths, which do not end where records do
    def run():
        return tcbench.simulate(method, "relative_equilibrium", dt=0.3, t_end=60.0, record_every=5)

    whole = run()
    monkeypatch.setattr(simulation, "CHUNK", 7)
    parts = run()
    for name in ("t", "z", "energy", "entropy", "temperatures", "newton_iterations"):
        assert np.array_equal(getattr(parts, name), getattr(whole, name)), name
    assert parts.summary == whole.summary
    assert whole.steps == 200


def test_the_first_flow_of_a_step_may_ask_for_its_start():
    def euler(z0, z1, h, system, start, first):
        return z1 - start - h * system.vector_field(start)

    def plain(z0, z1, h, system):
        return z1 - z0 - h * system.vector_field(z0)

    runs = [
        tcbench.simulate(Integrator(name="e", order=1, flows=flows), "short_term", dt=0.01, t_end=1.0)
        for flows in (Flow(euler, of_step=True), plain)
    ]
    assert runs[0].ok and np.array_equal(runs[0].z, runs[1].z)


def test_replace_makes_variants_and_leaves_the_original():
    scenario = SCENARIOS["short_term"]
    variant = scenario.replace(stiffness=(10.0, 100.0), t_end=200.0)
    assert list(variant.constants["stiffness"]) == [10.0, 100.0] and variant.t_end == 200.0
    assert list(scenario.constants["stiffness"]) == [0.1, 1.0] and scenario.t_end == 25.0
    assert variant.hash != scenario.hash
    for name in ("masses", "natural_lengths", "positions", "momenta", "temperatures"):
        values = scenario.constants.get(name, getattr(scenario, name, None))
        assert scenario.replace(**{name: values}).hash == scenario.hash


BAD_SCENARIOS = [
    ({"temperatures": (-1, 300)}, "temperatures must be positive"),
    ({"masses": (0, 1)}, "'masses' must be positive"),
    ({"positions": (0, 0, 1, 0)}, "collapsed"),
    ({"positions": (1, 0, 1, 0)}, "collapsed"),
    ({"momenta": (math.nan, 0, 0, 0)}, "must be finite"),
    ({"momenta": (0, 0, 0)}, "momenta must be 4 numbers, not 3"),
    ({"conductivity": -1}, "must not be negative"),
    ({"stiffness": (1, 2, 3)}, "must have shape (2,)"),
    ({"stifness": (1, 2)}, "Did you mean 'stiffness'?"),
    ({"t_end": 0}, "t_end must be positive"),
    ({"dt": 26}, "longer than t_end"),
    ({"heat_capacity": "five"}, "must be a number"),
]


@pytest.mark.parametrize(("changes", "sentence"), BAD_SCENARIOS)
def test_bad_scenario_data_are_refused_with_a_sentence(changes, sentence):
    with pytest.raises(TcbenchError) as caught:
        SCENARIOS["short_term"].replace(**changes)
    assert sentence in str(caught.value)


BAD_CALLS = [
    (("tc_monolitic", "short_term"), {}, "Did you mean 'tc_monolithic'?"),
    (("tc_monolithic", "short_trem"), {}, "Did you mean 'short_term'?"),
    (("tc_monolithic", "short_term"), {"dt": 0}, "dt must be positive"),
    (("tc_monolithic", "short_term"), {"dt": -0.1}, "dt must be positive"),
    (("tc_monolithic", "short_term"), {"dt": math.nan}, "dt must be positive and finite"),
    (("tc_monolithic", "short_term"), {"dt": 30}, "longer than the horizon"),
    (("tc_monolithic", "short_term"), {"dt": "big"}, "dt must be a number"),
    (("tc_monolithic", "short_term"), {"tolerance": 1e-6}, "takes a step dt, not a tolerance"),
    (("tc_monolithic", "short_term"), {"record_every": 0}, "record_every must be a whole number"),
    (("midpoint_temperature[reading=best]", "short_term"), {}, "Known: a5_literal, balance, rate"),
    (("midpoint_temperature[readin=rate]", "short_term"), {}, "Did you mean 'reading'?"),
    (("tc_monolithic[a=b]", "short_term"), {}, "No parameter of 'tc_monolithic' is called 'a'"),
]


@pytest.mark.parametrize(("args", "options", "sentence"), BAD_CALLS)
def test_bad_calls_are_refused_with_a_sentence(args, options, sentence):
    with pytest.raises(TcbenchError) as caught:
        tcbench.simulate(*args, **options)
    assert sentence in str(caught.value)


def euler(z, h, system):
    return z + h * system.vector_field(z)


def test_a_python_step_is_an_integrator():
    method = Integrator(name="euler", order=1, step=euler)
    run = tcbench.simulate(method, "short_term", dt=0.01, t_end=1.0)
    assert run.status == "ok" and run.steps == 100
    assert np.allclose(
        run.z[1], SCENARIOS["short_term"].z0 + 0.01 * SCENARIOS["short_term"].model.vector_field(run.z[0])
    )
    # two kernels, energy alone and all observables: which products are fused with sums is up to the compiler
    np.testing.assert_allclose(run.energy, SCENARIOS["short_term"].model.energy(run.z), rtol=1e-15)
    errors = [
        np.abs(tcbench.simulate(method, "bound_equilibrium", dt=h, t_end=1.0).z[-1] - tcbench.simulate(
            "tc_monolithic", "bound_equilibrium", dt=1e-4, t_end=1.0).z[-1]).max() for h in (0.002, 0.001)
    ]  # fmt: skip
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)


def raises(z, h, system):
    raise RuntimeError("no luck")


def gives_up(z, h, system):
    raise ArithmeticError("no root in reach")


def divides(z, h, system):
    return z / (1 // 0)


def wrong_shape(z, h, system):
    return z[:5]


def not_a_number(z, h, system):
    return z * np.nan


def in_place(z, h, system):
    z += 1.0  # a step may spoil its argument: it gets a copy
    return z


def collapsed(z, h, system):
    return np.where(np.arange(10) < 4, 0.0, z)


def explosive(z, h, system):
    return z + np.where((np.arange(10) >= 4) & (np.arange(10) < 8), 100.0, 0.0)


@pytest.mark.parametrize(
    ("step", "status", "sentence"),
    [
        (raises, "exception", "step 1 (t = 0.3): RuntimeError: no luck at test_simulate.py"),
        (gives_up, "nonconverged", "step 1 (t = 0.3): no root in reach"),
        (divides, "exception", "step 1 (t = 0.3): ZeroDivisionError: "),
        (wrong_shape, "exception", "returned shape (5,), a state has shape (10,)"),
        (not_a_number, "nonfinite", "step 1 (t = 0.3, dt = 0.3): the new state is not finite"),
        (collapsed, "unphysical", "step 1 (t = 0.3, dt = 0.3): an element collapsed"),
        (explosive, "blowup", "exceeded the initial exergy V0 = 48.5"),
    ],
)
def test_a_bad_step_is_a_status_and_a_sentence(step, status, sentence):
    run = tcbench.simulate(Integrator(name="bad", order=1, step=step), "short_term")
    assert run.status == status and sentence in run.failure
    assert np.all(np.isfinite(run.z)) and np.all(np.isfinite(run.energy))
    assert np.array_equal(run.z[0], SCENARIOS["short_term"].z0)


def test_a_solver_that_returns_no_states_is_told_which_are_asked_for():
    """Of SciPy's result it was said that it is no argument of float()."""
    run = tcbench.simulate(
        Integrator(name="bad", adaptive=lambda *_: object()), "short_term", tolerance=1e-3, t_end=1.0
    )
    assert run.status == "exception" and "the solver returned <object object" in run.failure
    assert "states of shape (" in run.failure and "were asked for" in run.failure


def test_a_step_that_spoils_its_argument_spoils_nothing_else():
    before = SCENARIOS["short_term"].z0.copy()
    tcbench.simulate(Integrator(name="bad", order=1, step=in_place), "short_term")
    assert np.array_equal(SCENARIOS["short_term"].z0, before)


def scipy_lsoda(system, z0, t_eval, rtol, atol):
    from scipy.integrate import solve_ivp

    solution = solve_ivp(
        lambda t, z: system.vector_field(z), (0, t_eval[-1]), z0, "LSODA", t_eval, rtol=rtol, atol=atol
    )
    return solution.y.T, {"rhs_evaluations": solution.nfev}


def test_an_adaptive_solver_is_an_integrator_swept_over_tolerance():
    method = Integrator(name="lsoda", adaptive=scipy_lsoda)
    loose = tcbench.simulate(method, "short_term", tolerance=1e-4)
    tight = tcbench.simulate(method, "short_term", tolerance=1e-9)
    assert tight.status == "ok" and math.isnan(tight.dt)
    assert tight.summary.energy_error_max < loose.summary.energy_error_max / 100
    assert tight.solver.rhs_evaluations > loose.solver.rhs_evaluations > 0
    with pytest.raises(TcbenchError, match="tolerance must be positive"):
        tcbench.simulate(method, "short_term", tolerance=-1)


def test_an_integrator_gives_exactly_one_way_to_step_and_an_order():
    with pytest.raises(TcbenchError, match="gives none of them"):
        Integrator(name="nothing", order=1)
    with pytest.raises(TcbenchError, match="gives flows and step"):
        Integrator(name="both", order=1, flows=lambda z0, z1, h, s: z1 - z0, step=euler)
    with pytest.raises(TcbenchError, match="must declare its order"):
        Integrator(name="orderless", step=euler)
    with pytest.raises(TcbenchError, match="lower-case"):
        Integrator(name="Bad Name", order=1, step=euler)
    with pytest.raises(TcbenchError, match="order must be a positive number, not 'two'"):
        Integrator(name="worded", order="two", step=euler)
    with pytest.raises(TcbenchError, match="a set of words"):
        Integrator(name="spelled", order=1, step=euler, claims="energy")


def test_what_numpy_refuses_in_a_formula_is_named_with_its_line():
    def solved(z0, z1, h, system):
        return np.linalg.solve(np.diag(z1), z1 - z0)

    with pytest.raises(TcbenchError, match=r"test_simulate.py, line \d+: the residual 'solved' .* step="):
        tcbench.simulate(Integrator(name="solved", order=1, flows=solved), "short_term")


def explicit(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0)


def test_an_explicit_formula_needs_no_newton_at_all():
    run = tcbench.simulate(
        Integrator(name="explicit", order=1, flows=explicit), "bound_equilibrium", dt=0.01, t_end=1.0
    )
    by_hand = tcbench.simulate(Integrator(name="euler", order=1, step=euler), "bound_equilibrium", dt=0.01, t_end=1.0)
    assert run.newton_iterations.sum() == 0
    assert np.allclose(run.z, by_hand.z, rtol=1e-12, atol=1e-12)


def wrong_size(z0, z1, h, system):
    return (z1 - z0)[:9]


def test_a_residual_of_the_wrong_size_is_refused():
    with pytest.raises(TcbenchError, match="returned 9 numbers; a state of 'pendulum' has 10"):
        tcbench.simulate(Integrator(name="bad", order=1, flows=wrong_size), "short_term")


def test_many_steps_hold_the_energy_and_keep_a_part_of_the_states():
    run = tcbench.simulate("tc_monolithic", "bound_equilibrium", dt=0.05, t_end=10_000.0, record_every=1000)
    assert run.steps == 200_000 and run.z.shape == (201, 10)
    assert run.summary.energy_error_max <= 1e-12
