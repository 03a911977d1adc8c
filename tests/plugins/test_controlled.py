"""`controlled`: a tolerance is kept, and so is every law of the method inside."""

import numpy as np
import pytest
from mechanics import OfEntropies
from tcbench_plugins.controlled import controlled

import tcbench
from tcbench import Integrator, Scenario, System, TcbenchError
from tcbench.reference.lookup import reference_for


@pytest.mark.parametrize("method", ["controlled", "controlled[method=tc_strang]"])
@pytest.mark.parametrize("scenario", ["bound_equilibrium", "short_term"])
def test_the_tolerance_and_the_laws_are_kept(method, scenario):
    scenario = tcbench.scenarios()[scenario].replace(t_end=5.0)
    exact = reference_for(scenario, [5.0]).states[0]
    steps = []
    for tolerance in (1e-4, 1e-6):
        run = tcbench.simulate(method, scenario, tolerance=tolerance)
        error = np.abs((run.z[-1] - exact) / (1 + np.abs(exact))).max()
        assert run.ok and error < 5 * tolerance, (error, tolerance)  # errors of steps grow on the way to the end
        assert run.summary.energy_error_max < 1e-12 * max(scenario.initial_exergy, abs(run.energy[0]))
        assert run.summary.entropy_increment_min > -1e-12
        assert run.summary.invariant_error_max["angular_momentum"] < 1e-11
        steps.append(run.steps)
    if method != "controlled":  # order two: a hundredth of the tolerance, ten times the steps
        assert 5 < steps[1] / steps[0] < 20, steps


class Cage(System):
    """A particle that flies between two hard walls."""

    variables = {"q": (), "p": (), "s": ()}
    constants = {"power": ()}

    def energy(self, z):
        return z.p**2 / 2 + z.q**-self.power + (8 - z.q) ** -self.power + z.s

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}


@pytest.mark.parametrize("power", [12, 18])
def test_a_step_that_the_method_takes_in_parts_says_nothing_of_its_error(power):
    """tc_gauss halves steps that it cannot solve: the whole one and two of half the length were the same parts, and
    differed by a thousandth of what both missed."""
    cage = Scenario("cage", Cage, {"power": power}, initial={"q": 4.0, "p": -8.0, "s": 0.0}, t_end=29.7, dt=0.1)
    exact = tcbench.simulate("tc_taylor", cage, tolerance=1e-12, times=[29.7]).z[-1]
    for tolerance in (1e-5, 1e-6):
        run = tcbench.simulate("controlled", cage, tolerance=tolerance, times=[29.7])
        assert run.ok and np.abs(run.z[-1] - exact).max() < 50 * tolerance  # each collision adds to it


def test_a_method_without_the_laws_keeps_the_tolerance_and_claims_nothing():
    method = tcbench.plugins.find_integrator("controlled[method=verlet_heat4]")
    run = tcbench.simulate(method, "short_term", t_end=5.0, tolerance=1e-6)
    exact = reference_for(tcbench.scenarios()["short_term"], [5.0]).states[0]
    assert run.ok and np.abs((run.z[-1] - exact) / (1 + np.abs(exact))).max() < 4e-6
    assert method.claims == tcbench.integrators()["verlet_heat4"].claims and "energy" not in method.claims


def test_a_fixed_tolerance_is_that_whatever_is_asked_for():
    fixed = [tcbench.simulate("controlled[method=tc_monolithic,tol=1e-3]", "short_term", t_end=2.0, tolerance=t)
             for t in (1e-2, 1e-5)]  # fmt: skip
    asked = tcbench.simulate("controlled[method=tc_monolithic]", "short_term", t_end=2.0, tolerance=1e-3)
    assert np.array_equal(fixed[0].z, fixed[1].z) and np.array_equal(fixed[0].z, asked.z)


def test_where_no_step_exists_the_run_says_so():
    def broken(z, h, system):
        raise ArithmeticError("no")

    run = tcbench.simulate(controlled(Integrator(name="broken", order=2, step=broken)), "short_term")
    assert run.status == "nonconverged" and "no step of broken is short enough at t = 0: no" in run.failure


def test_a_tolerance_below_round_off_is_refused_at_once():
    run = tcbench.simulate("controlled[method=tc_monolithic]", "short_term", t_end=25.0, tolerance=1e-9)
    assert run.status == "nonconverged" and "errors below round-off; take a looser one" in run.failure


def test_every_one_step_method_can_be_controlled_and_nothing_else():
    allowed = tcbench.integrators()["controlled"].parameters["method"]
    assert allowed[0] == "tc_gauss" and {"tc_monolithic", "verlet_heat", "projected"} <= set(allowed)
    assert not {"scipy_odeint", "controlled", "tc_gauss_adaptive"} & set(allowed)
    with pytest.raises(TcbenchError, match="one-step"):
        controlled(tcbench.integrators()["scipy_odeint"])


class Disc(OfEntropies):
    """Two springs, and friction within a small disc."""

    name = "disc"
    variables = {"x": (2,), "p": (2,), "s": ()}
    constants = {"k": (2,)}

    def energy(self, z):
        return (z.p**2).sum() / 2 + (self.k * z.x**2).sum() / 2 + np.exp(z.s)

    def reversible(self, z, dE, dS):
        return {"x": dE.p, "p": -dE.x}

    def irreversible(self, z, dE, dS):
        c = np.where(np.sqrt(z.x[0] ** 2 + z.x[1] ** 2) < 0.02, 20.0, 0.0)
        return {"p": -c * dE.p, "s": c * (dE.p**2).sum() / dE.s}


@pytest.mark.parametrize("t_end", [1.9, 2.0, 2.3, 3.0])
def test_a_small_disc_is_not_passed_in_one_step(t_end):
    """Distances to it at both ends of a step, and their slopes, said that it was not met."""
    start = {"x": [1.0, 0.14142], "p": [0.0, 0.15], "s": 0.0}
    scenario = Scenario("disc", Disc, {"k": [1.0, 2.0]}, initial=start, t_end=t_end, dt=0.1)
    exact = tcbench.simulate("tc_taylor", scenario, tolerance=1e-9).z[-1]
    run = tcbench.simulate("controlled", scenario, tolerance=1e-3, times=[t_end])
    assert exact[-1] > 0.2 and run.ok and np.abs(run.z[-1] - exact).max() < 1e-2
