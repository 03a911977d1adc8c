"""The physical laws, for every integrator that claims them, on every scenario and on random admissible states."""

import functools
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from states import admissible_states

import tcbench
from tcbench import TcbenchError

SCENARIOS = tcbench.scenarios()
WRAPPERS = ("controlled", "projected")  # adaptive members are all other methods: tests/plugins has theirs
ASIDE = [name for name, i in tcbench.integrators().items() if not i.by_default]  # by themselves: tests/plugins has more
FEW = (
    "stiff_spring",
    "cold_spring",
    "gas_containers",
    "damped_oscillator",
    "heavy_top",
    "reaction",
)  # for those, and in the first tier for variants
METHODS = {
    v.name: v
    for i in tcbench.integrators().values()
    if not i.systems
    for v in (i.variants() if i.by_default else [i])
    if not v.lacks
    and (v.name == i.name or i.name not in WRAPPERS or v.kind != "adaptive")
    and not any(f"={name}]" in v.name for name in ASIDE)
}
VARIANTS = list(METHODS)
STEPPED = [name for name, method in METHODS.items() if method.kind != "adaptive"]
LOW_ORDER = [name for name in STEPPED if METHODS[name].order <= 2]  # plugins/test_tc_gauss.py measures others
EPS = np.finfo(float).eps
EXACT = 1e-12  # what thousands of converged solves may leave of a conserved quantity, relative to its scale


def explicit(name):
    """Whether a method has a limit, and beyond it no step: it has to say so, and keeps its laws below."""
    return bool(METHODS[name].tags & {"explicit", "projected"})


@functools.cache
def claiming(law):
    return [name for name, method in METHODS.items() if law in method.claims]


@functools.cache
def run(integrator, scenario):
    for parts in (1, 4, 16, 64, 256) if explicit(integrator) else (1,):
        result = tcbench.simulate(integrator, scenario, dt=SCENARIOS[scenario].dt / parts)
        if result.ok:
            break
    return result


def suits(integrator, scenario):
    return not METHODS[integrator].suits(SCENARIOS[scenario].model)


def on_every_scenario(*laws, scenarios=tuple(SCENARIOS)):
    """Of the methods that claim all these laws, on each scenario that they can run on."""
    methods = [name for name in VARIANTS if all(name in claiming(law) for law in laws)]
    pairs = [(i, s) for i in methods for s in scenarios if suits(i, s) and (i not in ASIDE or s in FEW)]
    assert {i for i, _ in pairs} == set(methods) and {s for _, s in pairs} == set(scenarios)
    marks = [[pytest.mark.thorough] if "[" in i and s not in FEW else [] for i, s in pairs]  # of variants
    found = [pytest.param(*pair, marks=marked) for pair, marked in zip(pairs, marks, strict=True)]
    return pytest.mark.parametrize(("integrator", "scenario"), found)


UNSUITABLE = [(i, s) for i in VARIANTS for s in SCENARIOS if not suits(i, s)]


@pytest.mark.parametrize(("integrator", "scenario"), UNSUITABLE)
def test_a_method_that_asks_for_more_than_a_system_has_is_refused_there(integrator, scenario):
    reason = METHODS[integrator].suits(SCENARIOS[scenario].model)
    with pytest.raises(TcbenchError, match=re.escape(reason)):
        tcbench.simulate(integrator, scenario)


@on_every_scenario("energy")
def test_first_law_energy_is_conserved(integrator, scenario):
    result = run(integrator, scenario)
    assert result.status == "ok"
    assert result.summary.energy_error_max <= EXACT


@on_every_scenario("entropy")
def test_second_law_entropy_never_decreases(integrator, scenario):
    assert run(integrator, scenario).summary.entropy_increment_min >= -1e-13  # what one converged solve leaves over


TURNING = [name for name, scenario in SCENARIOS.items() if "angular_momentum" in scenario.model.invariant_names]


@on_every_scenario("angular_momentum", scenarios=TURNING)
def test_angular_momentum_is_conserved(integrator, scenario):
    result = run(integrator, scenario)
    # adaptive methods made of others add states up without the loops' compensation: some eps a step
    left = EXACT + (16 * EPS * result.steps if METHODS[integrator].kind == "adaptive" else 0.0)
    assert result.summary.invariant_error_max["angular_momentum"] <= left * abs(result.angular_momentum[0])


@on_every_scenario("energy", "entropy")
def test_lyapunov_functional_never_increases(integrator, scenario):
    # Theorem 6: E - theta_ref S; round-off of theta_ref S is all that may show
    assert run(integrator, scenario).summary.lyapunov_increment_max <= EXACT


def variants_later(names):
    """Those that are variants of others in the second tier."""
    return [pytest.param(name, marks=[pytest.mark.thorough] if "[" in name else []) for name in names]


SHORTER = 64  # explicit methods at 0.3: conduction's stability limit


def step_from(integrator, y, h):
    """One step from a random state (q, p, theta) of the short_term pendulum; None if the step has no answer."""
    h = h / SHORTER if explicit(integrator) else h
    scenario = SCENARIOS["short_term"].replace(
        positions=y[:4], momenta=y[4:8], temperatures=y[8:], t_end=h, dt=h, name="one"
    )
    result = tcbench.simulate(integrator, scenario)
    return result if result.steps == 1 else None


@pytest.mark.parametrize("integrator", variants_later(STEPPED))
@settings(max_examples=25)
@given(admissible_states(), st.floats(0.001, 0.3))
def test_claimed_laws_hold_on_one_step_from_random_states(integrator, y, h):
    result = step_from(integrator, y, h)
    claims = tcbench.plugins.find_integrator(integrator).claims
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


@pytest.mark.parametrize("integrator", variants_later(STEPPED))
@settings(max_examples=10)
@given(admissible_states(), st.floats(0, 2 * np.pi))
def test_equivariance_a_rotated_start_gives_the_rotated_step(integrator, y, angle):
    c, s = np.cos(angle), np.sin(angle)
    R = np.kron(np.eye(4), np.array([[c, -s], [s, c]]))
    turned = np.concatenate([R @ y[:8], y[8:]])
    a, b = step_from(integrator, y, 0.05), step_from(integrator, turned, 0.05)
    assume(a is not None and b is not None)
    assert np.allclose(R @ a.z[1, :8], b.z[1, :8], rtol=1e-11, atol=1e-11)
    assert np.allclose(a.z[1, 8:], b.z[1, 8:], rtol=1e-11, atol=1e-11)


REFERENCE = np.array([  # short_term at t = 1, to 20 digits
    1.5895928678481363203, 4.0028041675297446839, 3.736897584681968334, -0.40450629831574224972, 0.76487732990986293532,
    5.7596886167318336099, 3.882703437832831369, -1.5158252665756274906, 0.5654757062370114219, 0.73002895262877143456,
])  # fmt: skip


@pytest.mark.parametrize("integrator", LOW_ORDER)
def test_declared_order_is_the_measured_order(integrator):
    late = explicit(integrator) or METHODS[integrator].memory  # whose first step, another method's, meets the layer
    steps = np.array([0.0025, 0.00125]) / (16 if late else 1)
    errors = [
        np.abs(tcbench.simulate(integrator, "short_term", dt=h, t_end=1.0).z[-1] - REFERENCE).max() for h in steps
    ]
    order = np.log2(errors[0] / errors[1])
    assert order == pytest.approx(tcbench.plugins.find_integrator(integrator).order, abs=0.05)


def test_midpoint_rules_blow_up_on_the_stiff_spring_and_tc_methods_do_not():
    for name in ("midpoint_entropy", "midpoint_temperature"):
        result = run(name, "stiff_spring")
        assert result.status == "blowup" and result.t[-1] == pytest.approx(1.2, abs=0.31)
    for name in claiming("energy"):
        assert run(name, "stiff_spring").status == "ok"


def test_second_law_is_broken_by_the_rate_reading():
    assert run("midpoint_temperature[reading=rate]", "short_term").summary.second_law_violations > 0
