"""Elimination before Newton: rows that give one another's unknowns leave as many as have to be solved for."""

import numpy as np
from mechanics import Mechanical

import tcbench
from tcbench import Scenario


class Volumes(Mechanical):
    """Tetrahedra that resist a change of their volumes alone, each linear in the place of any one of its corners."""

    name = "volumes"
    variables = {"q": ("node", 3), "p": ("node", 3), "s": ("cell",)}
    tables = {"of": ("cell", 4, "node")}
    constants = {"mass": ("node",)}

    def energy(self, z):
        x = z.q[self.of]
        edges = np.stack([x[:, k] - x[:, 0] for k in (1, 2, 3)], axis=1)
        return (z.p**2 / (2 * self.mass[:, None])).sum() + np.linalg.det(edges).sum() + np.exp(z.s).sum()

    def irreversible(self, z, dE, dS):
        return {}


def test_rows_that_give_one_anothers_unknowns():
    """What one eliminates may stand in the formula of what was eliminated before it."""
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    start = {"q": places, "p": np.cos(np.arange(15.0)).reshape(5, 3), "s": np.zeros(2)}
    constants = {"of": [[0, 1, 2, 3], [1, 2, 3, 4]], "mass": np.ones(5)}
    scenario = Scenario("volumes", Volumes, constants, initial=start, t_end=1, dt=0.1)
    run = tcbench.simulate("tc_monolithic", scenario)
    assert run.ok and run.summary.energy_error_max < 1e-14
    exact = tcbench.simulate("scipy_dop853", scenario, tolerance=1e-10).z[-1]
    errors = [np.abs(tcbench.simulate("tc_monolithic", scenario, dt=h).z[-1] - exact).max() for h in (0.05, 0.025)]
    assert 1.9 < np.log2(errors[0] / errors[1]) < 2.1
