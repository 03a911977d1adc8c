"""Systems of one number, without energy, and with an invariant that is 0: on all methods."""

import numpy as np
import pytest
from mechanics import Warm

from tcbench import Scenario, System, TcbenchError, integrators, simulate


class Flow(System):
    """A gradient flow of the entropy: one number, and no energy at all."""

    variables = {"x": ()}

    def energy(self, z):
        return 0.0

    def entropy(self, z):
        return -(z.x**2) / 2 - z.x**4 / 4

    def irreversible(self, z, dE, dS):
        return {"x": dS.x}


class Pair(Warm):
    """Two masses on a line with a spring and a dashpot between them, whose momentum is 0."""

    variables = {"q": (2,), "p": (2,), "s": ()}

    def energy(self, z):
        return (z.p**2).sum() / 2 + 2 * (z.q[1] - z.q[0] - 1) ** 2 + 3 * np.exp(z.s / 3)

    def irreversible(self, z, dE, dS):
        v = dE.p[1] - dE.p[0]
        return {"p": np.array([v, -v]) / 5, "s": v**2 / 5 / dE.s}

    def invariants(self, z):
        return {"momentum": z.p.sum(), "nothing": 0 * z.p.sum()}


SCENARIOS = {
    "flow": Scenario("flow", Flow, {}, initial={"x": 1.5}, t_end=1, dt=0.05, shows="one number", source="here"),
    "pair": Scenario("pair", Pair, {}, initial={"q": [0, 1.4], "p": [0.5, -0.5], "s": 0}, t_end=2, dt=0.05,
                     shows="an invariant that is 0", source="here"),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_method_runs_and_all_end_at_the_same_state(name):
    """A law that is constantly 0 has no room for round-off: a mended state was then none, at any step."""
    scenario, far = SCENARIOS[name], {}
    best = simulate("tc_gauss_adaptive", scenario, tolerance=1e-10)
    for k, method in enumerate(integrators().values()):
        if k % 2 == (name == "pair") and method.name not in ("tc_taylor", "tc_auto", "tc_monolithic"):
            continue  # on the other one
        try:
            run = simulate(method, scenario)
        except TcbenchError:  # it says that it is not for such systems
            continue
        assert run.ok, (method.name, run.failure)
        far[method.name] = float(np.abs(run.z[-1] - best.z[-1]).max())
        if "energy" in method.claims:
            assert run.summary.energy_error_max < 1e-12, method.name
    assert {"tc_taylor", "tc_auto", "tc_monolithic"} <= far.keys()
    assert max(far.values()) < 0.05, far  # of the explicit and first-order ones at this step


class Top(System):
    """A rigid body by its matrix L(m), and no entropy at all: L has nothing to be orthogonal to."""

    variables = {"m": (3,)}

    def energy(self, z):
        return (z.m**2 / np.array([1.0, 2.0, 3.0])).sum() / 2

    def entropy(self, z):
        return 0.0

    def poisson(self, z):
        o = 0 * z.m[0]
        return np.array([[o, -z.m[2], z.m[1]], [z.m[2], o, -z.m[0]], [-z.m[1], z.m[0], o]])


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_gauss", "midpoint_entropy"])
def test_a_matrix_stands_beside_a_constant_entropy(method):
    top = Scenario("top", Top, {}, initial={"m": [1.0, 0.1, 0.2]}, t_end=3, dt=0.1, shows="no entropy", source="here")
    run = simulate(method, top)
    assert run.ok and run.summary.energy_error_max < 1e-13
    assert np.allclose((run.z**2).sum(axis=1), 1.05, atol=1e-13)
