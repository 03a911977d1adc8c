"""Formulas of a network that know how many entries they see, or which one they have give the author's numbers."""

import numpy as np
import pytest

import tcbench
from tcbench import Scenario
from tcbench.plugins import find_scenario
from tcbench.solver.flow_kernels import build
from tcbench.systems.network import Network
from tcbench.systems.spring_network import SpringNetwork

N = 24
ROW = np.arange(N)


def sharing(self, a, b):
    k = self.conductivity / len(a)
    return k * ((b - a) / a), k * ((a - b) / b)


def in_order(self, a, b):
    k = self.conductivity * np.where(np.arange(np.shape(a)[0]) < N // 2, 1.0, 2.0)
    return k * ((b - a) / a), k * ((a - b) / b)


def mean_of_them(self, a, b):
    k = self.conductivity * np.mean(a) / 300.0
    return k * ((b - a) / a), k * ((a - b) / b)


def share_of_energy(self, pi, s):
    return SpringNetwork.element_energy(self, pi, s) / len(s)


def stiffer_in_company(self, pi, s):
    return SpringNetwork.element_energy(self, pi, s) * (2.0 if len(s) > 20 else 1.0)


def mean_strain(self, pi, s):
    return SpringNetwork.element_energy(self, pi, s) + 0.0 * s * np.sum(s) / np.size(s) + 1.0 / pi.shape[0]


def lighter(self):
    return self.per_position(self.masses / len(self.masses))


def shorter(self, q):
    return SpringNetwork.element_shape(self, q) * (1.0 + 1.0 / len(q[0]))


def mean_spin(self, q, p):
    return {"angular_momentum": (q[0] * p[1] - q[1] * p[0]) / len(q[0])}


def along_the_row(self, a, b):
    k = self.conductivity * np.linspace(1.0, 2.0, N - 1)
    return k * ((b - a) / a), k * ((a - b) / b)


def heavier_outside(self):
    return self.per_position(self.masses) * np.linspace(1.0, 2.0, 2 * N)


def torque(self, q, p):
    return {"torque": sum(np.arange(len(p)) * p)}


def offset(self):
    return 3.0 / len(self.masses)


FAULTS = {
    "link over their number": {"link": sharing}, "link by place": {"link": in_order},
    "link of a mean": {"link": mean_of_them}, "energy over their number": {"element_energy": share_of_energy},
    "energy of many": {"element_energy": stiffer_in_company}, "energy and a number": {"element_energy": mean_strain},
    "inertia over their number": {"inertia": lighter}, "shape and a number": {"element_shape": shorter},
    "link and an array": {"link": along_the_row}, "inertia and an array": {"inertia": heavier_outside},
    "invariant of places": {"invariants": torque}, "mean invariant": {"point_invariants": mean_spin},
    "offset": {"exergy_offset": offset},
}  # fmt: skip


def net(name, **formulas):
    kind = type("Formulas", (SpringNetwork,), {"name": name, **formulas})
    pairs = np.stack([np.r_[N, : N - 1], np.arange(N)], axis=1)
    made = kind.over(pairs, np.zeros((1, 2)), __module__=__name__, __qualname__="Made", __doc__="")
    constants = {"masses": np.ones(N), "stiffness": np.full(N, 10.0), "natural_lengths": np.ones(N),
                 "conductivity": 10.0, "reference_temperature": 300.0, "coupling": 0.2,
                 "heat_capacity": 5.0}  # fmt: skip
    return Scenario(
        name=name, system=made, constants=constants,
        positions=np.stack([1.1 * (ROW + 1), 0.1 * np.sin(ROW)], axis=1).ravel(),
        momenta=np.stack([0 * ROW, 0.5 * np.sin(0.7 * (ROW + 1))], axis=1).ravel(),
        temperatures=300 + 20 * np.cos(ROW), t_end=0.2, dt=0.1,
    )  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_every_number_is_the_authors_own(name):
    s = net(name, **FAULTS[name])
    m, z = s.model, s.model.state(s.z0)
    theta = m.temperatures(z)
    with np.errstate(all="ignore"):
        own = m.element_energy(m.shape(z.q), z.s)
        energy = float(sum(0.5 * z.p**2 / m.inertia()) + sum(own))
    assert m.energy(z) == pytest.approx(energy, rel=1e-13)
    assert m.momenta(z) == pytest.approx(list(m.invariants(z.q, z.p).values()), rel=1e-12)
    assert np.allclose(m.shapes(z), m.shape(z.q), rtol=1e-13)
    field = m.state(m.vector_field(z))
    assert np.allclose(field.s, m.conduction(theta), rtol=1e-10, atol=1e-13)
    assert np.allclose(field.q, z.p / m.inertia(), rtol=1e-13)
    seen = np.asarray(m.observe(z))
    assert seen[0] == pytest.approx(energy, rel=1e-13) and seen[2 + len(m.invariant_names) :][:N] == pytest.approx(
        theta
    )
    assert m.exergy(z) == pytest.approx(energy - 300.0 * sum(z.s) + m.exergy_offset(), rel=1e-9)


def test_methods_of_all_kinds_solve_one_system():
    s = net("sharing", link=sharing).replace(t_end=0.4)
    ours, theirs = tcbench.simulate("tc_gauss", s, dt=0.05), tcbench.simulate("scipy_dop853", s, tolerance=1e-10)
    assert ours.ok and theirs.ok
    assert np.allclose(ours.z[-1], theirs.z[-1], rtol=1e-6, atol=1e-6)


def test_what_does_the_same_with_all_stays_in_loops():
    s = net("alike", link=lambda self, a, b: (self.conductivity * (b - a) / a, self.conductivity * (a - b) / b))
    (flow,) = tcbench.integrators()["tc_monolithic"].flows
    assert "in loops" in build(flow, s.model).way
    assert "in loops" in build(flow, find_scenario("net[nx=6,ny=6]").model).way
    assert "link() gives links other values" in build(flow, net("unlike", link=sharing).model).way


def test_a_small_part_has_nothing_as_often_as_representatives_by_chance():
    """Twelve springs that meet in one mass of two: a formula of len(masses) would look right on them."""
    from tcbench.systems.same_for_all import small_network

    ends = np.r_[np.zeros(30, int), np.ones(30, int), 2 * np.ones(30, int)]

    class Stars(Network):
        n_positions = 3
        elements = np.stack([ends, 3 + np.zeros(90, int)], axis=1)
        anchors = np.zeros(1)
        links = np.stack([np.arange(89), np.arange(1, 90)], axis=1)
        points = np.arange(3)[:, None]
        constants = {"reference_temperature": ()}

    small = small_network(Stars(reference_temperature=1.0))
    assert small.n_positions != 2 and small.mesh_sizes()["link"] != 2
