"""A constant that is exactly zero is folded into the kernels: what it switches off is no unknown and costs nothing."""

import numpy as np
import pytest
from tcbench_plugins.net.net import net

import tcbench

FULL = tcbench.scenarios()["short_term"]
METHODS = ["tc_monolithic", "midpoint_temperature", "tc_gauss", "tc_taylor", "projected"]


def test_an_adiabatic_pendulum_has_four_unknowns():
    unknowns = {
        kappa: tcbench.simulate("tc_monolithic", FULL.replace(conductivity=kappa), dt=0.1, t_end=0.2).solver.way
        for kappa in (300.0, 0.0)
    }
    assert unknowns == {300.0: "unrolled: 6 unknowns", 0.0: "unrolled: 4 unknowns"}


@pytest.mark.parametrize(("method", "name"), [*((m, "conductivity") for m in METHODS), ("tc_monolithic", "coupling")])
def test_states_are_those_of_a_constant_next_to_zero(method, name):
    off, near = (tcbench.simulate(method, FULL.replace(**{name: x}), dt=0.1, t_end=3.0) for x in (0.0, 1e-250))
    # lengths of tc_taylor's steps see rounding errors; a projection solves for an energy of 422 to its last places
    most = {"tc_taylor": 1e-10, "projected": 1e-11}.get(method, 1e-12)
    assert off.ok and np.abs(off.z - near.z).max() < most
    if name == "conductivity" and method == "tc_monolithic":
        assert np.array_equal(off.z[:, 8:], np.tile(off.z[0, 8:], (len(off.z), 1)))  # entropies stay


def test_in_a_network_as_well():
    for name, unknowns in (("conductivity", 40), ("coupling", 73)):
        scenario = net(5, 4)
        off, near = (scenario.replace(**{name: x}) for x in (0.0, 1e-250))
        runs = [tcbench.simulate("tc_monolithic", s, dt=0.1, t_end=0.5) for s in (off, near)]
        assert runs[0].ok and np.abs(runs[0].z - runs[1].z).max() < 1e-12
        assert runs[0].solver.way.startswith(f"sparse: {unknowns} unknowns, in loops")


def test_one_of_several_entries_may_be_zero():
    off, near = (FULL.replace(stiffness=(0.1, x)) for x in (0.0, 1e-250))
    runs = [tcbench.simulate("tc_monolithic", s, dt=0.1, t_end=2.0) for s in (off, near)]
    assert runs[0].ok and np.abs(runs[0].z - runs[1].z).max() < 1e-12
