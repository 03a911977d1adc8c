"""Chains, nets and bars with dashpots, and the bar of a continuum: lawful, and what mechanics says of them."""

import numpy as np
import pytest
from tcbench_plugins.net.bar import bar

import tcbench
from tcbench import TcbenchError
from tcbench.plugins import find_scenario

NAMES = ["chain[n=2,viscosity=8]", "chain[n=12,viscosity=8]", "net[nx=4,ny=3,viscosity=8]", "truss3d[viscosity=8]"]


@pytest.mark.parametrize("name", NAMES)
def test_the_laws_hold_with_dashpots(name):
    run = tcbench.simulate("tc_monolithic", name, dt=0.1, t_end=0.5)
    assert run.ok and run.scenario.name.startswith(name.partition("[")[0])
    assert run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > 0.0


def test_a_stiff_dashpot_is_a_spring_and_a_weak_one_nothing():
    """The branch stays as it was where the dashpot hardly flows, and has relaxed where it flows at once."""
    stiff, weak = (find_scenario(f"net[nx=3,ny=3,viscosity={x}]") for x in ("1e9", "1e-6"))
    for scenario, moves in ((stiff, False), (weak, True)):
        run = tcbench.simulate("tc_monolithic", scenario, dt=0.05, t_end=0.5)
        model, z = scenario.model, run.scenario.model.state(run.z[-1])
        gap = np.abs(model.strain(z.q) - z.alpha).max()
        still = np.abs(z.alpha - model.state(scenario.z0).alpha).max()
        assert run.ok and (gap < 1e-4) == moves and (still < 1e-6) == (not moves)


def test_what_is_no_viscosity_is_refused():
    for value in ("x", "-1", "0", "inf"):
        with pytest.raises(TcbenchError, match=r"viscosity of (net is a number|dashpots must be positive)"):
            find_scenario(f"net[viscosity={value}]")
    assert find_scenario("net").name == "net[nx=4,ny=4]"


@pytest.mark.parametrize("n", [4, 16])
def test_a_bar_keeps_the_laws(n):
    run = tcbench.simulate("tc_monolithic", bar(n), t_end=0.2)
    assert run.ok and ("loops" in run.solver.way) == (n == 16)
    assert run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > 0.0


def test_waves_of_a_bar_have_the_speed_of_sound():
    """Elastic and cold: the lowest mode, of a quarter wave, has the frequency pi/2 sqrt(E/rho)/length."""
    n = 12
    scenario = bar(n, viscous_modulus=0.0, expansion=0.0, conductivity=0.0, t_end=2.0, dt=0.02)
    shape = np.sin(np.pi / 2 * (np.arange(n) + 1) / n)
    run = tcbench.simulate("tc_monolithic", scenario.replace(u=0.01 * shape))
    expected = 0.01 * np.cos(np.pi / 2 * np.sqrt(10.0) * run.t)
    assert np.abs(run.z[:, n - 1] - expected).max() < 3e-4


def test_a_bar_has_a_whole_number_of_elements():
    with pytest.raises(TcbenchError, match="n of bar is a whole number from 2 to 100000, not 'x'"):
        find_scenario("bar[n=x]")


def test_the_energy_of_many_like_elements_is_summed_without_round_off_of_one_sign():
    """2e-13 when 1000 like terms were added one after the other, 1e-12 of 10,000: round-off of the measure."""
    assert tcbench.simulate("tc_monolithic", "bar[n=1000]", t_end=0.04).summary.energy_error_max < 2e-14


@pytest.mark.parametrize("method", ["gauss2", "cpg"])
def test_methods_with_stages_take_arrays_with_internal_variables(method):
    """Of unknowns eliminated one after the other the first was still in terms of the last: no kernel could be made."""
    assert tcbench.simulate(method, "bar[n=20]", t_end=0.04).ok
