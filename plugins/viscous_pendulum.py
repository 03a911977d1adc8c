"""The paper's double pendulum with a Maxwell branch beside each spring: a spring and a dashpot in a row.

The strain alpha of a dashpot is an internal variable; its relaxation heats the spring. Everything is dimensionless.
"""

import numpy as np

from tcbench import Scenario, System, hookimpl

SOURCE = "Romero (2009), section 4, with an internal variable (beyond the paper)"


class ViscousPendulum(System):
    name = "viscous_pendulum"
    source = SOURCE
    variables = {"q": (2, 2), "p": (2, 2), "alpha": (2,), "s": (2,)}
    constants = {
        "masses": (2,), "stiffness": (2,), "branch_stiffness": (2,), "viscosity": (2,), "natural_lengths": (2,),
        "conductivity": (), "coupling": (), "heat_capacity": (), "reference_temperature": (),
    }  # fmt: skip
    positive = ("masses", "viscosity", "natural_lengths", "heat_capacity", "reference_temperature")
    non_negative = ("stiffness", "branch_stiffness", "conductivity")

    def measures(self, z):
        """The squared lengths of the springs."""
        a, b = z.q[0], z.q[1] - z.q[0]
        return np.array([a @ a, b @ b])

    def energy(self, z):
        """Eq. (43) and the branches."""
        theta, c = self.reference_temperature, self.heat_capacity
        L = np.log(self.measures(z)) / 2 - np.log(self.natural_lengths)
        springs = self.stiffness / 2 * L**2 + self.branch_stiffness / 2 * (L - z.alpha) ** 2
        heat = self.coupling * theta * L + c * theta * (np.exp((z.s - self.coupling * L) / c) - 1)
        kinetic = (z.p[0] @ z.p[0]) / (2 * self.masses[0]) + (z.p[1] @ z.p[1]) / (2 * self.masses[1])
        return kinetic + springs.sum() + heat.sum()

    def entropy(self, z):
        return z.s.sum()

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        flow, (a, b) = -dE.alpha / self.viscosity, dE.s
        conduction = self.conductivity * np.array([(b - a) / a, (a - b) / b])
        return {"alpha": flow, "s": conduction - flow * dE.alpha / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s

    def invariants(self, z):
        (x, y), (u, v) = z.q.T, z.p.T
        return {"angular_momentum": (x * v - y * u).sum()}

    def points(self, z):
        """The springs."""
        return [[(0, 0), z.q[0]], [z.q[0], z.q[1]]]


@hookimpl
def tcbench_scenarios():
    return [
        Scenario(
            name="viscous_pendulum",
            system=ViscousPendulum,
            constants={
                "masses": (1, 2), "stiffness": (0.1, 1), "branch_stiffness": (10, 20), "viscosity": (20, 40),
                "natural_lengths": (2, 1), "conductivity": 10, "coupling": 0.2, "heat_capacity": 5,
                "reference_temperature": 300,
            },
            initial={
                "q": [[2.2, 0], [3.4, 0]], "p": [[0, 2], [0, 4]], "alpha": [0, 0],
                "s": [0.2 * np.log(1.1) + 5 * np.log(330 / 300), 0.2 * np.log(1.2)],  # theta = 330, 300
            },
            t_end=100,
            dt=0.3,
            shows="an internal variable: strain relaxes into heat until the springs rotate at rest, with J kept",
            source=SOURCE,
        )
    ]  # fmt: skip
