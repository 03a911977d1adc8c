"""At the edges: states that are judged, scenarios without motion or conduction, arguments of the wrong kind."""

import math

import numpy as np
import pytest

import tcbench
from tcbench import TcbenchError
from tcbench.simulation import compiled_loop as march
from tcbench.simulation import metrics

SCENARIOS = tcbench.scenarios()

BAD = [
    *((where, i, bad, march.NONFINITE) for where, size in (("z", 4), ("now", 3)) for i in range(size)
      for bad in (math.nan, math.inf, -math.inf)),
    ("now", 3, 0.0, march.COLD), ("now", 4, -1.0, march.COLD), ("now", 5, 0.0, march.COLLAPSED),
    ("now", 6, math.inf, march.NONFINITE), ("now", 0, 2.1, march.BLOWUP), ("now", 0, -0.1, march.BLOWUP),
    ("now", 0, 1.9, march.OK), ("z", 0, 1e308, march.OK),
]  # fmt: skip


@pytest.mark.parametrize(("where", "index", "value", "expected"), BAD)
def test_each_entry_of_a_state_and_of_its_observables_is_judged(where, index, value, expected):
    z, now = np.full(4, 1e308), np.ones(7)  # energy, entropy, one momentum, two temperatures, two strain measures
    limits, shape = np.zeros(march.LIMITS_SIZE), np.zeros(march.SHAPE_SIZE, dtype=np.int64)
    limits[march.V0], shape[march.N_INVARIANTS], shape[march.N_ELEMENTS] = 1.0, 1, 2
    {"z": z, "now": now}[where][index] = value
    with np.errstate(invalid="ignore"):  # as plain Python, 0 times infinity warns
        assert march.verdict(z, now, np.ones(7), limits, shape) == expected


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
        assert run.ok and metrics.energy_error_max(run) < 1e-2, method  # of a scale that is 1e-10 of E0


def test_a_momentum_that_cancels_is_measured_against_its_terms():
    scenario = SCENARIOS["short_term"].replace(name="j", positions=(0.1, 0.3, 1.1, 3.3), momenta=(0.3, 0.9, 0.7, 2.1))
    run = tcbench.simulate("tc_monolithic", scenario, dt=0.3)
    assert 0.0 < abs(run.angular_momentum[0]) < 1e-14
    assert metrics.angular_momentum_error_max(run) < 1e-12


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((5, "short_term"), "a name or an Integrator"), (("tc_strang", 7), "a name or a Scenario"),
        (("tc_strang", "short_term", 1e-9), "give record_every= a larger number"),
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
