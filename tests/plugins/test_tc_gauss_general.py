"""tc_gauss on any system, by the cut of its graphs: what springs have, stiff variants, what it refuses."""

import numpy as np
import pytest
from mechanics import Mechanical
from tcbench_plugins.tc_gauss.method import GaussMethod

import tcbench
from tcbench import System, TcbenchError

SCENARIOS = tcbench.scenarios()
STIFF = {  # a thousand times the dissipation
    "damped_oscillator": {"friction": 10},
    "viscous_pendulum": {"viscosity": (0.02, 0.04)},
    "rubbing_piston": {"friction": 200, "conductivity": 500},
    "rigid_body": {"damping": 200},
    "heavy_top": {"friction": 150},
    "reaction": {"speed": 700},
}


def test_springs_are_a_special_case():
    """A pendulum without branches, once by elements and once by its energy alone: the same steps."""
    springs = SCENARIOS["short_term"]
    shared = {
        name: springs.constants[name] for name in SCENARIOS["viscous_pendulum"].constants if name in springs.constants
    }
    general = SCENARIOS["viscous_pendulum"].replace(branch_stiffness=(0, 0), **shared)
    z, zero = springs.z0, np.zeros(2)
    initial = {"q": z[:4].reshape(2, 2), "p": z[4:8].reshape(2, 2), "alpha": zero, "s": z[8:]}
    ours = tcbench.simulate("tc_gauss", general.replace(initial=initial), dt=0.1, t_end=3.0).z[-1]
    theirs = tcbench.simulate("tc_gauss", springs, dt=0.1, t_end=3.0).z[-1]
    assert np.delete(ours, [8, 9]) == pytest.approx(theirs, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize(
    "name", [n if n != "viscous_pendulum" else pytest.param(n, marks=pytest.mark.slow) for n in STIFF]
)
def test_stiff_systems(name):
    """Laws at a fixed step; adaptive ones keep them, too, and come to where a stiff solver comes."""
    scenario = SCENARIOS[name].replace(t_end=10.0, **STIFF[name])
    exact = tcbench.simulate("solve_ivp_radau", scenario, tolerance=1e-11).z[-1]
    runs = [
        tcbench.simulate("tc_gauss", scenario, dt=0.25),
        tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=1e-5),
    ]
    for run in runs:
        assert run.ok and run.summary.energy_error_max <= 1e-12
        assert run.summary.entropy_increment_min >= -1e-14
        assert max(run.summary.invariant_error_max.values(), default=0.0) <= 1e-12
    assert runs[1].z[-1] == pytest.approx(exact, rel=1e-5, abs=1e-5)


def test_the_entropy_of_a_step_that_is_rejected_binds_none_that_follows():
    """It had risen further than a shorter step can, which was moved there: errors of 0.2 at any tolerance."""
    scenario = SCENARIOS["viscous_pendulum"].replace(viscosity=(0.2, 0.4), conductivity=1000)
    span, every = np.array([0.0, 8.0]), tcbench.integrators()
    run, exact = (
        every[name].adaptive(scenario.model, scenario.z0, span, 1e-6, 1e-6)[0][-1]
        for name in ("tc_gauss_adaptive", "tc_taylor")
    )
    assert run == pytest.approx(exact, abs=1e-4)


@pytest.mark.parametrize(("name", "stiffer", "tolerance", "most"), [
    ("reaction", {"speed": 70}, 1e-6, 25), ("reaction", {"speed": 700}, 1e-3, 25),
    ("fast_conduction", {"conductivity": 3e6}, 1e-3, 55),
])  # fmt: skip
def test_what_was_too_long_once_is_not_for_long(name, stiffer, tolerance, most):
    """58, 80 and 66 steps on average when that bound grew by a tenth a step; now 14, 17 and 36."""
    scenario, solve = SCENARIOS[name].replace(**stiffer), tcbench.integrators()["tc_gauss_adaptive"].adaptive
    tolerances, span = tolerance * 10.0 ** np.linspace(-0.4, 0.4, 5), np.array([0.0, scenario.t_end])
    assert np.mean([solve(scenario.model, scenario.z0, span, x, x)[1]["steps"] for x in tolerances]) < most


def test_a_large_system_is_refused_in_a_sentence():
    class Many(System):
        name = "many"
        variables = {"q": (200,), "p": (200,)}

        def energy(self, z):
            return (z.p @ z.p + z.q @ z.q) / 2

        def entropy(self, z):
            return z.q[0]

    with pytest.raises(TcbenchError, match="400 are too many for it"):
        GaussMethod(Many(), 2)


class Distances(Mechanical):
    """Two masses, their energy written in distances."""

    name = "distances"
    variables = {"q": (2, 2), "p": (2, 2), "s": ()}
    constants = {"k": ()}
    of = None

    def energy(self, z):
        return np.sum(z.p**2) / 2 + self.of(*z.q) + np.exp(z.s)

    def invariants(self, z):
        return {"spin": np.sum(z.q[:, 0] * z.p[:, 1] - z.q[:, 1] * z.p[:, 0])}


ENERGIES = {
    "spring": lambda self, a, b: self.k * (np.hypot(*(b - a)) - 1) ** 2,
    "to the origin": lambda self, a, b: np.hypot(*a) ** 3 + self.k * np.hypot(b[0], b[1]) ** 3,
    "gravity": lambda self, a, b: -self.k / np.hypot(*(b - a)),
    "of hypot of hypot": lambda self, a, b: self.k * np.cosh(np.hypot(np.hypot(*a), np.hypot(*(b - a)))),
    "softened": lambda self, a, b: self.k * np.log(np.hypot(0.3 + 0 * a[0], np.hypot(*(a - b)))),
    "in a root": lambda self, a, b: np.sqrt(self.k + np.hypot(*a)) + np.hypot(*(a - 2 * b)) ** 3,
}


@pytest.mark.parametrize("name", ENERGIES)
def test_an_energy_of_distances_by_hypot_keeps_what_turns(name):
    """The cut took what stands in a hypot for its own, x and y, which turn: spin departed by 1.6e-2."""
    made = type("Distances", (Distances,), {"of": ENERGIES[name], "name": "by_hypot"})
    initial = {"q": [[0.4, 0.9], [-0.8, 0.1]], "p": [[0.3, -0.2], [0.1, 0.5]], "s": 0.0}
    scenario = tcbench.Scenario("by_hypot", made, {"k": 1.3}, initial=initial, t_end=4.0, dt=0.1)
    run = tcbench.simulate("tc_gauss[k=1]", scenario)
    assert run.ok and run.summary.energy_error_max < 1e-12
    assert run.summary.invariant_error_max["spin"] < 1e-12
