"""At the edges: states that are judged, scenarios without motion or conduction, arguments of the wrong kind."""

import math

import numpy as np
import pytest

import tcbench
from tcbench import TcbenchError
from tcbench.simulation import metrics
from tcbench.simulation.compiled_loop import LOOPS, Run
from tcbench.solver import implicit_step as codes

SCENARIOS = tcbench.scenarios()

BAD = [
    *((where, i, bad, codes.NONFINITE) for where, size in (("z", 4), ("now", 3)) for i in range(size)
      for bad in (math.nan, math.inf, -math.inf)),
    ("now", 3, 0.0, codes.COLD), ("now", 4, -1.0, codes.COLD), ("now", 5, 0.0, codes.COLLAPSED),
    ("now", 6, math.inf, codes.NONFINITE), ("now", 0, 2.1, codes.BLOWUP), ("now", 0, -0.1, codes.BLOWUP),
    ("now", 0, 1.9, codes.OK), ("z", 0, 1e308, codes.OK),
]  # fmt: skip


def test_each_entry_of_a_state_and_of_its_observables_is_judged():
    run = Run(
        n=4, n_elements=2, n_invariants=1, n_observables=7, n_constants=0, n_others=2, n_rows=0, n_mended=0, bound=1.0
    )
    run.observables[:] = 1.0
    for where, index, value, expected in BAD:
        z, now = np.full(4, 1e308), np.ones(7)  # energy, entropy, one momentum, two temperatures, two strain measures
        {"z": z, "now": now}[where][index] = value
        assert LOOPS.verdict(run, z, now) == expected, (where, index, value)


def test_no_conduction_and_no_motion_are_scenarios_like_others():
    scenario = SCENARIOS["short_term"]
    still = scenario.replace(conductivity=0.0, name="insulated")
    for method in ("verlet_heat", "verlet_heat4", "tc_strang_exact"):
        run = tcbench.simulate(method, still, t_end=3.0)
        assert run.ok and np.abs(run.z[:, 8:] - run.z[0, 8:]).max() < 1e-12, method
    assert tcbench.simulate("projected", still, t_end=3.0).ok  # its projection may move entropies
    rest = scenario.replace(name="rest", momenta=(0,) * 4, temperatures=(300, 300), positions=(2, 0, 3, 0), t_end=3.0)
    for method in ("tc_monolithic", "midpoint_entropy", "verlet_heat", "tc_gauss"):
        run = tcbench.simulate(method, rest)
        assert run.ok and run.summary.energy_error_max < 1e-2, method  # of a scale that is 1e-10 of E0


def test_a_momentum_that_cancels_is_measured_against_its_terms():
    scenario = SCENARIOS["short_term"].replace(name="j", positions=(0.1, 0.3, 1.1, 3.3), momenta=(0.3, 0.9, 0.7, 2.1))
    run = tcbench.simulate("tc_monolithic", scenario, dt=0.3)
    assert 0.0 < abs(run.angular_momentum[0]) < 1e-14
    assert metrics.invariant_errors(run)["angular_momentum_error_max"] < 1e-12


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((5, "short_term"), "a name or an Integrator"), (("tc_strang", 7), "a name or a Scenario"),
        (("tc_strang", "short_term", 1e-9), "record_every= a larger number"),
    ],
)  # fmt: skip
def test_wrong_kinds_of_arguments_are_named(arguments, sentence):
    with pytest.raises(TcbenchError, match=sentence):
        tcbench.simulate(*arguments)
    with pytest.raises(TcbenchError, match="tolerance must be a number"):
        tcbench.simulate("scipy_odeint", "short_term", tolerance="x")
    for bad in (0, 1.5, math.nan, math.inf, "a"):
        with pytest.raises(TcbenchError, match="record_every must be a whole number"):
            tcbench.simulate("tc_strang", "short_term", record_every=bad)
