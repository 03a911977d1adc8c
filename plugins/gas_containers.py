"""Two gas containers that exchange heat and volume through a wall: a second system, in one file.

Ideal gas on both sides of a wall that moves without friction and conducts heat. z = (q, p, S1, S2): position and
momentum of the wall, entropies of the gases. The containers have the volumes q and 2 - q (cross-section 1), and

    E_i = (exp(S_i)/V_i)^(2/3),   theta_i = 2/3 E_i,   dp/dt = 2/3 (E1/q - E2/(2 - q)),
    dS1/dt = 9 alpha/(4 E1) (1/E1 - 1/E2), and its mirror.

Everything is dimensionless. No integrator knows of this system: all of them run on it unchanged.
"""

import numpy as np

from tcbench import ElementSystem, Scenario, hookimpl

SOURCE = "Shang and Ottinger (2020), Proc. R. Soc. A 476: 20190446, doi 10.1098/rspa.2019.0446"


class GasContainers(ElementSystem):
    name = "gas_containers"
    source = SOURCE
    n_positions = 1
    n_elements = 2
    constants = {"mass": (), "conductivity": (), "reference_temperature": ()}
    positive = ("mass", "reference_temperature")
    non_negative = ("conductivity",)

    def inertia(self):
        """The wall's mass."""
        return np.array([self.mass])

    def shape(self, q):
        """The volumes."""
        return np.array([q[0], 2.0 - q[0]])

    def element_energy(self, pi, s):
        """Internal energy of an ideal gas of volume pi and entropy s."""
        return (np.exp(s) / pi) ** (2 / 3)

    def conduction(self, theta):
        """9 alpha/(4 E1) (1/E1 - 1/E2) with E = 3/2 theta, as a difference of temperatures."""
        a, b = theta
        return self.conductivity * np.array([(b - a) / (a * a * b), (a - b) / (a * b * b)])

    def entropies(self, q, theta):
        """s = 3/2 ln E + ln V."""
        return 1.5 * np.log(1.5 * theta) + np.log(self.shape(q))

    def points(self, q):
        """Each gas as the line from its end of the cylinder to the wall."""
        return [[(0, 0), (q[0], 0)], [(2, 0), (q[0], 0)]]

    def exergy_offset(self):
        """Minus the least of E - theta_ref S: equal volumes, both gases at theta_ref."""
        reference = self.reference_temperature
        return 3 * reference * np.log(1.5 * reference) - 3 * reference


PRINTED = {"mass": 1, "conductivity": 0.5, "reference_temperature": 4 / 3}


@hookimpl
def tcbench_scenarios():
    start = Scenario(
        name="gas_containers",
        system=GasContainers,
        constants=PRINTED,
        positions=(1,),
        momenta=(2,),
        temperatures=(4 / 3, 4 / 3),  # E1 = E2 = 2; the exergy is then the wall's kinetic energy, V0 = 2
        t_end=30,
        dt=0.1,
        shows="another system, every integrator unchanged; the wall comes to rest",
        source=SOURCE,
    )
    return [start]
