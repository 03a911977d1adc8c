"""Formulas that have no root, or none that can be found, are refused with a sentence; none ends ok without moving."""

import numpy as np
import pytest

import tcbench
from tcbench import Integrator, Scenario, TcbenchError
from tcbench.building_blocks import phi
from tcbench.systems.pendulum import Pendulum

START = tcbench.scenarios()["short_term"]
INFINITE = {
    "the new state": lambda z0, z1, h, system: np.inf * z1,
    "the increment": lambda z0, z1, h, system: -np.inf * (z1 - z0),
    "a sum": lambda z0, z1, h, system: z1 - z0 + np.inf,
    "a rate": lambda z0, z1, h, system: z1 - z0 - h * np.inf * system.vector_field(z0),
    "one row": lambda z0, z1, h, system: np.concatenate([(z1 - z0)[:-1], [1e200 * (np.exp(z1[-1]) * 1e200 * 1e200)]]),
    "a logarithm": lambda z0, z1, h, system: z1 - z0 - h * np.log(0.0 * z0),
}


@pytest.mark.parametrize("scenario", ["short_term", "chain[n=12]"])
@pytest.mark.parametrize("name", INFINITE)
def test_infinite_numbers_do_not_end_ok(name, scenario):
    method = Integrator(name="infinite", order=1, flows=INFINITE[name])
    try:
        with np.errstate(all="ignore"):
            run = tcbench.simulate(method, scenario, dt=0.05, t_end=0.1)
    except TcbenchError as error:
        by_number = name == "one row" and scenario != "short_term"  # of arrays there is no last entry
        assert ("is asked for by number" if by_number else "contains an infinite number") in str(error)
    else:
        assert not run.ok


@pytest.mark.parametrize("scenario", ["short_term", "chain[n=12]"])
def test_a_residual_that_vanishes_has_no_root_of_its_own(scenario):
    method = Integrator(name="nil", order=1, flows=lambda z0, z1, h, system: (z1 - z0) / np.inf)
    with pytest.raises(TcbenchError, match="'<lambda>' does not depend on z1"):
        tcbench.simulate(method, scenario, dt=0.05, t_end=0.1)


@pytest.mark.parametrize("scenario", ["short_term", "chain[n=12]"])
def test_a_formula_that_returns_the_new_state_is_told_what_a_residual_is(scenario):
    """It was told to reorder its rows."""
    method = Integrator(name="euler", order=1, flows=lambda z0, z1, h, system: z0 + h * system.vector_field(z0))
    with pytest.raises(TcbenchError, match=r"does not depend on z1\. Return what is 0 where z1 is the new state"):
        tcbench.simulate(method, scenario, dt=0.05, t_end=0.1)


class Blocks(Pendulum):
    """Heat by the building block: exp(x) - 1 = x phi(x)."""

    name = "blocks"

    def element_energy(self, pi, s):
        c0, theta_ref = self.heat_capacity, self.reference_temperature
        L = self.log_strain(pi)
        x = (s - self.coupling * L) / c0
        return self.stiffness / 2 * L**2 + self.coupling * theta_ref * L + c0 * theta_ref * x * phi(x)


def blocks():
    return Scenario(
        name="blocks", system=Blocks, constants=START.constants, positions=START.positions, momenta=START.momenta,
        temperatures=START.temperatures, t_end=1.0, dt=0.05,
    )  # fmt: skip


@pytest.mark.parametrize("method", ["tc_gauss", "midpoint_entropy", "gauss2"])
def test_energies_made_of_building_blocks_have_all_derivatives(method):
    runs = [tcbench.simulate(method, s, dt=0.05, t_end=1.0) for s in (blocks(), START)]
    assert runs[0].ok and np.allclose(runs[0].z[-1], runs[1].z[-1], rtol=1e-10, atol=1e-11)


def test_their_rates_have_the_digits_of_the_formula_written_out():
    field, plain = (np.asarray(s.model.vector_field(s.z0)) for s in (blocks(), START))
    assert np.allclose(field, plain, rtol=1e-14, atol=1e-14)


def test_methods_that_have_no_rule_for_them_say_so():
    with pytest.raises(TcbenchError, match=r"test_refused_formulas.py, line \d+: a building block stands in"):
        tcbench.simulate("tc_monolithic", blocks())
    assert "no series of the operation 'phi'" in tcbench.simulate("tc_taylor[order=8]", blocks()).failure
