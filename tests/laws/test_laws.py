"""The physical laws, for every integrator that claims them, on scenarios of every kind and random admissible states."""

import functools
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from laws import assert_laws
from spread import OTHERS, PENDULUM, SCENARIOS, spread, suits
from states import admissible_states

import tcbench
from tcbench import TcbenchError

WRAPPERS = ("controlled", "projected")  # adaptive members are all other methods: tests/plugins has theirs
METHODS = {
    v.name: v
    for i in tcbench.integrators().values()
    for v in (i.variants() if i.by_default else [i])
    if not v.lacks and (v.name == i.name or i.name not in WRAPPERS or v.kind != "adaptive")
}
BASES, VARIANTS = [name for name in METHODS if "[" not in name], [name for name in METHODS if "[" in name]
STEPPED = [name for name in BASES if METHODS[name].kind != "adaptive"]
LOW_ORDER = [name for name in STEPPED if METHODS[name].order <= 2]  # plugins/test_tc_gauss.py measures others
CLAIMING = [name for name in BASES if METHODS[name].claims]
FIRST = [*spread(CLAIMING, PENDULUM, core=CLAIMING), *spread(CLAIMING, OTHERS)]
SECOND = spread([name for name in VARIANTS[::2] if METHODS[name].claims], ["stiff_spring", *OTHERS], core=())
THIRD = [(i, s) for i in METHODS for s in SCENARIOS
         if suits(i, s) and METHODS[i].claims and (i, s) not in FIRST + SECOND]  # fmt: skip


def explicit(name):
    """Whether a method has a limit, and beyond it no step: it has to say so, and keeps its laws below."""
    return bool(METHODS[name].tags & {"explicit", "projected"})


IN_PYTHON = 500  # steps of a step function, which may take milliseconds each


@functools.cache
def run(integrator, scenario):
    for parts in (1, 4, 16, 64, 256) if explicit(integrator) else (1,):
        own = SCENARIOS[scenario]
        t_end = min(own.t_end, IN_PYTHON * own.dt) if METHODS[integrator].kind == "step" else own.t_end
        result = tcbench.simulate(integrator, scenario, dt=own.dt / parts, t_end=t_end / parts)  # as many steps
        if result.ok:
            break
    return result


@pytest.mark.parametrize(
    ("integrator", "scenario"),
    [*FIRST, *(pytest.param(*pair, marks=pytest.mark.thorough) for pair in SECOND),
     *(pytest.param(*pair, marks=pytest.mark.slow) for pair in THIRD)],
)  # fmt: skip
def test_claimed_laws_hold_energy_entropy_momentum_and_lyapunovs_function(integrator, scenario):
    # no other law than the energy's sees to it that a step has a root, and of explicit ones none does
    sure = "energy" in METHODS[integrator].claims and not explicit(integrator)
    if sure or run(integrator, scenario).steps:
        # a projection or a relaxation leaves round-off of its own, which adds up
        assert_laws(run(integrator, scenario), *((1e-12, 1e-13, 1e-12) if sure else (1e-11, 1e-13, 1e-11)), ended=sure)


def test_every_method_and_every_scenario_is_among_the_first():
    assert {i for i, _ in FIRST} == set(CLAIMING) and {s for _, s in FIRST} == set(SCENARIOS)


def test_a_method_that_asks_for_more_than_a_system_has_is_refused_there():
    refused = [(i, s) for i in BASES for s in ("short_term", *OTHERS) if not suits(i, s)]
    assert {"conduction_flow" in METHODS[i].needs for i, _ in refused} == {True, False}
    for integrator, scenario in refused:
        with pytest.raises(TcbenchError, match=re.escape(METHODS[integrator].suits(SCENARIOS[scenario].model))):
            tcbench.simulate(integrator, scenario)


SHORTER = 64  # explicit methods at 0.3: conduction's stability limit


def step_from(integrator, y, h):
    """One step from a random state (q, p, theta) of the short_term pendulum; None if the step has no answer."""
    h = h / SHORTER if explicit(integrator) else h
    scenario = SCENARIOS["short_term"].replace(
        positions=y[:4], momenta=y[4:8], temperatures=y[8:], t_end=h, dt=h, name="one"
    )
    result = tcbench.simulate(integrator, scenario)
    return result if result.steps == 1 else None


@pytest.mark.parametrize("integrator", [name for name in STEPPED if suits(name, "short_term")])
@settings(max_examples=10)
@given(admissible_states(), st.sampled_from([0.003, 0.05, 0.3]), st.floats(0, 2 * np.pi))
def test_claimed_laws_hold_on_one_step_from_random_states_and_a_rotated_start_gives_the_rotated_step(
    integrator, y, h, angle
):
    result, claims = step_from(integrator, y, h), METHODS[integrator].claims
    if "energy" in claims and not explicit(integrator):
        # an implicit TC step has a root at every h (docs/stability.md): a lost one is a fault of the solver
        assert result is not None and result.status == "ok"
    assume(result is not None)
    V0 = max(result.scenario.initial_exergy, 1.0)
    scale = V0 + abs(result.energy[0])  # one step: round-off is relative to the energy itself
    if "energy" in claims:
        assert abs(result.energy[1] - result.energy[0]) <= 1e-13 * scale
    if "entropy" in claims:
        assert result.entropy[1] - result.entropy[0] >= -1e-13 * max(1.0, abs(result.entropy[0]))
    if "angular_momentum" in claims:
        arms = np.abs(result.z[:, :4]).max() * max(1.0, np.abs(result.z[:, 4:8]).max())
        assert abs(result.angular_momentum[1] - result.angular_momentum[0]) <= 1e-13 * arms
    c, s = np.cos(angle), np.sin(angle)
    R = np.kron(np.eye(4), np.array([[c, -s], [s, c]]))
    turned = step_from(integrator, np.concatenate([R @ y[:8], y[8:]]), h)
    if h <= 0.05 and turned is not None:  # of long steps round-off grows further
        assert np.allclose(R @ result.z[1, :8], turned.z[1, :8], rtol=1e-11, atol=1e-11)
        assert np.allclose(result.z[1, 8:], turned.z[1, 8:], rtol=1e-11, atol=1e-11)


REFERENCE = np.array([  # short_term at t = 1, to 20 digits
    1.5895928678481363203, 4.0028041675297446839, 3.736897584681968334, -0.40450629831574224972, 0.76487732990986293532,
    5.7596886167318336099, 3.882703437832831369, -1.5158252665756274906, 0.5654757062370114219, 0.73002895262877143456,
])  # fmt: skip


@pytest.mark.parametrize("integrator", [name for name in LOW_ORDER if suits(name, "short_term")])
def test_declared_order_is_the_measured_order(integrator):
    late = explicit(integrator) or METHODS[integrator].memory  # whose first step, another method's, meets the layer
    steps = np.array([0.0025, 0.00125]) / (16 if late else 1)
    errors = [
        np.abs(tcbench.simulate(integrator, "short_term", dt=h, t_end=1.0).z[-1] - REFERENCE).max() for h in steps
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(METHODS[integrator].order, abs=0.05)


def test_midpoint_rules_blow_up_on_the_stiff_spring():
    for name in ("midpoint_entropy", "midpoint_temperature"):
        result = run(name, "stiff_spring")
        assert result.status == "blowup" and result.t[-1] == pytest.approx(1.2, abs=0.31)


def test_second_law_is_broken_by_the_rate_reading():
    assert run("midpoint_temperature[reading=rate]", "short_term").summary.second_law_violations > 0
