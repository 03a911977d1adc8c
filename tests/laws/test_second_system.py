"""Integrators are written against `System`: they run unchanged on another one, and keep what they claim.

Two gas containers with a moving wall: E_i = (exp(S_i)/V_i)^(2/3), V = q and 2 - q, theta_i = 2/3 E_i, wall of mass 1.
"""

import numpy as np
import pytest

import tcbench
from tcbench import ElementSystem, Scenario, TcbenchError
from tcbench.plugins import find_integrator

ASIDE = [name for name, i in tcbench.integrators().items() if not i.by_default]  # tests/plugins/test_field.py has more
METHODS = [
    v for i in tcbench.integrators().values() if not i.systems for v in (i.variants() if i.by_default else [i])
    if v.kind != "adaptive" and not any(f"={name}]" in v.name for name in ASIDE)
]  # fmt: skip
CLOSED_FORM = [v.name for v in METHODS if "conduction_flow" in v.needs]  # which the gas does not have
ALL = [v.name for v in METHODS if v.name not in CLOSED_FORM]
LOW_ORDER = [name for name in ALL if find_integrator(name).order <= 2]  # tests/test_gauss.py measures the higher ones


class Gas(ElementSystem):
    name = "gas_in_a_test"
    n_positions = 1
    n_elements = 2
    constants = {"conductivity": (), "reference_temperature": ()}

    def inertia(self):
        return np.array([1.0])

    def shape(self, q):
        return np.array([q[0], 2.0 - q[0]])

    def element_energy(self, pi, s):
        return (np.exp(s) / pi) ** (2 / 3)

    def conduction(self, theta):
        a, b = theta
        return self.conductivity * np.array([(b - a) / (a * a * b), (a - b) / (a * b * b)])

    def entropies(self, q, theta):
        return 1.5 * np.log(1.5 * theta) + np.log(np.array([q[0], 2.0 - q[0]]))

    def exergy_offset(self):
        ref = self.reference_temperature  # the least of E - ref S is at equal volumes and temperatures ref
        return 3 * ref * np.log(1.5 * ref) - 3 * ref


SCENARIO = Scenario(
    name="gas", system=Gas, constants={"conductivity": 0.5, "reference_temperature": 1.3}, positions=(1.0,),
    momenta=(2.0,), temperatures=(4 / 3, 4 / 3), t_end=30.0, dt=0.05,
)  # fmt: skip


def plain_field(z):
    """The equations as printed, in plain numpy."""
    q, p, s1, s2 = z
    E1, E2 = (np.exp(s1) / q) ** (2 / 3), (np.exp(s2) / (2 - q)) ** (2 / 3)
    rates = [9 * 0.5 / (4 * E1) * (1 / E1 - 1 / E2), 9 * 0.5 / (4 * E2) * (1 / E2 - 1 / E1)]
    return np.array([p, 2 / 3 * (E1 / q - E2 / (2 - q)), *rates])


def test_the_derived_vector_field_is_the_printed_one():
    rng = np.random.default_rng(1)
    for _ in range(20):
        z = np.array([rng.uniform(0.2, 1.8), *rng.uniform(-1, 1, 3)])
        assert np.allclose(SCENARIO.model.vector_field(z), plain_field(z), rtol=1e-12, atol=1e-12)
        assert np.allclose(
            SCENARIO.model.friction(SCENARIO.model.temperatures(z)) @ np.ones(2), plain_field(z)[2:], atol=1e-12
        )
        jacobian = np.stack([plain_field(z + 1j * 1e-30 * e).imag / 1e-30 for e in np.eye(4)], axis=-1)
        assert np.allclose(SCENARIO.model.jacobian(z), jacobian, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    "integrator", [pytest.param(name, marks=[pytest.mark.thorough] if "[" in name else []) for name in ALL]
)
def test_every_integrator_runs_unchanged_and_keeps_what_it_claims(integrator):
    run = tcbench.simulate(integrator, SCENARIO)
    claims = find_integrator(integrator).claims
    assert run.status == "ok"
    if "energy" in claims:
        assert run.summary.energy_error_max <= 1e-12
    if "entropy" in claims:
        assert run.summary.entropy_increment_min >= -1e-13


@pytest.mark.parametrize("integrator", CLOSED_FORM)
def test_a_method_that_needs_more_than_the_system_has_says_so(integrator):
    with pytest.raises(TcbenchError, match="needs conduction_flow, which the system gas_in_a_test"):
        tcbench.simulate(integrator, SCENARIO)


@pytest.mark.parametrize("integrator", LOW_ORDER)
def test_declared_orders_are_measured_here_too(integrator):
    # unequal temperatures: from equal ones the first-order term of a staggered step nearly cancels
    scenario = SCENARIO.replace(name="uneven", temperatures=(1.7, 1.1))
    exact = tcbench.simulate("tc_monolithic", scenario, dt=5e-5, t_end=0.5).z[
        -1
    ]  # error 1e-9: far below those compared
    errors = [
        np.abs(tcbench.simulate(integrator, scenario, dt=h, t_end=0.5).z[-1] - exact).max() for h in (0.005, 0.0025)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(find_integrator(integrator).order, abs=0.07)
