"""Units decide nothing: a scenario posed in units that are powers of two of its own gives the same, scaled."""

from functools import cache

import numpy as np
import pytest
from in_units import general, springs
from spread import spread

import tcbench
from tcbench.plugins import find_integrator, find_scenario
from tcbench.systems.magnitudes import _moved, exergy_at

STEPS = 12
SPRINGS = ("short_term", "chain[n=3]")
SYSTEMS = ["short_term", "damped_oscillator", "rigid_body", "reaction", "heavy_top", "rubbing_piston"]
MORE = ("tc_gauss[k=2]", "tc_taylor[order=8]", "projected[method=solve_ivp_rk45]", "controlled[method=gauss3]")
# Of what is measured by magnitudes these are in the method itself: which state a projection moves to, and from where
# on tc_gonzalez takes a slope for one of its own. 1 in the units of a scenario, they are what moves in others: see
# docs/add-scenario.md. The laws are kept in any; the states differ by parts of the method's own error.
BY_SIZE = {"projected", "multiple_relaxation", "cpg_invariant", "tc_taylor", "tc_gonzalez", "tc_gauss", "controlled"}
ROUND_OFF = 1e-11  # of a run of STEPS steps over the size of a variable: the flows amplify it a thousand times at most
TOLERANCE, FAR = 1e-7, 1e4  # BDF of order 1 to 5 misses a thousand times what it is asked for, with other weights
METHODS = [name for name in [*tcbench.integrators(), *MORE] if not find_integrator(name).lacks]


@cache
def in_units(name, seed):
    """The scenario in random units: (scenario, unit of each number of a state); seed 0: in its own."""
    scenario, rng = find_scenario(name), np.random.default_rng([29, seed])
    if name in SPRINGS:
        return springs(scenario, rng.integers(-20, 21, 4) if seed else np.zeros(4))[:2]
    count = len(scenario.model.variables)
    powers = 2.0 ** (rng.integers(-24, 25, 3 + count) if seed else np.zeros(3 + count))
    return general(scenario, dict(zip(scenario.model.variables, powers[3:], strict=True)), *powers[:3])[:2]


@cache
def run(name, method, seed):
    scenario, unit = in_units(name, seed)
    integrator = find_integrator(method)
    length = {"tolerance": TOLERANCE} if integrator.kind == "adaptive" else {"dt": scenario.dt / 8}
    found = tcbench.simulate(integrator, scenario, t_end=STEPS * scenario.dt / 8, **length)
    return found, found.z * unit


def suits(method, name):
    """Which a fixed step of a series does not, where conduction bounds it: it says so by no status."""
    beyond = method == "tc_taylor[order=8]" and name == "short_term"
    return not beyond and not any(find_integrator(method).suits(in_units(name, seed)[0].model) for seed in (0, 1))


def sizes(model, energy, z):
    """Of each number: the largest of its variable on the way, or as far as the energy moves it."""
    far, found = _moved(model, z[0], energy), np.empty(model.size)
    for k, (a, b, _) in enumerate(model.layout.values()):
        found[a:b] = max(far[k], np.abs(z[:, a:b]).max())
    return found


PAIRS = spread(METHODS, SYSTEMS, ("tc_monolithic", "tc_gauss"), suits)
PAIRS += [("tc_monolithic", name) for name in ("chain[n=3]", "viscous_pendulum")]
# in the first tier those that ask for sizes themselves, and of each way to step some that leave it to the solver
FIRST = BY_SIZE | {"tc_monolithic", "gauss2", "relaxation", "verlet_heat4", "bdf2", "scipy_odeint", "tc_auto"}


@pytest.mark.parametrize(
    ("method", "name"),
    [p if p[0].partition("[")[0] in FIRST else pytest.param(*p, marks=pytest.mark.thorough) for p in PAIRS],
)
def test_a_run_is_the_same_in_any_unit(method, name):
    own, z = run(name, method, 0)
    model = in_units(name, 0)[0].model
    size = sizes(model, exergy_at(model, z[0]), z)
    adaptive = find_integrator(method).kind == "adaptive"
    allowed = FAR * TOLERANCE if adaptive else 1e-3 if method.partition("[")[0] in BY_SIZE else ROUND_OFF
    other, there = run(name, method, 1)
    assert other.status == own.status, other.failure
    if own.ok:
        assert (np.abs(there[-1] - z[-1]) / size).max() < allowed
        assert other.steps <= 8 * own.steps + 20
        kept = "energy" in find_integrator(method).claims
        most = 0.0 if kept else FAR * TOLERANCE if adaptive else 1.01 * own.summary.energy_error_max
        assert other.summary.energy_error_max <= most + 3e-12


def test_scenarios_that_ship_are_measured_by_1_and_peers_run_on_them_as_they_are():
    """A peer whose variables are scaled took twice the time on runs of some microseconds."""
    for name, scenario in tcbench.scenarios().items():
        model = scenario.model
        assert (np.array([*model.magnitudes, *model.law_magnitudes]) == 1.0).all(), name
        assert model.unit_sizes is None and model.absolute(1e-6) == 1e-6
    scaled = in_units("short_term", 1)[0].model
    sizes = scaled.state_magnitudes
    assert np.array_equal(scaled.absolute(1e-6), 1e-6 * sizes) and scaled.unit_sizes is sizes
