"""Open systems: both laws of the whole, exactly, at any step; and the work and heat that were supplied."""

from dataclasses import replace

import numpy as np
import pytest

import tcbench
from tcbench import Scenario, System
from tcbench.errors import TcbenchError
from tcbench.simulation import metrics
from tcbench.systems.outside import OUTSIDE, driven, supplied


class Hung(System):
    """A mass on a spring whose end is moved, with a force that follows it, and a heat bath."""

    name = "hung"
    variables = {"q": (2,), "p": (2,), "s": (), "heat": ()} | OUTSIDE
    constants = {"load": (2,), "outside": ()}

    def inside(self, z):
        r = z.q - np.stack([0.2 * np.sin(2 * z.clock), 0.0 * z.clock])
        e = (r @ r - 1) / 2
        return (z.p @ z.p) / 2 + 5 * e**2 + np.exp(z.s - 0.3 * e) - np.cos(z.clock) * (self.load @ z.q)

    def energy(self, z):
        return self.inside(z) + z.work + self.outside * z.heat

    def entropy(self, z):
        return z.s + z.heat

    def reversible(self, z, dE, dS):
        return driven(dE, {"q": dE.p, "p": -dE.q}, p=0.3 * np.stack([-z.q[1], z.q[0]]))

    def irreversible(self, z, dE, dS):
        flow = 0.5 * (dE.heat - dE.s)
        return {"s": flow / dE.s, "heat": -flow / dE.heat}

    def temperature(self, z, dE, dS):
        return dE.s


START = {"q": [1.0, 0.0], "p": [0.0, 0.5], "s": 0.0, "heat": 0.0, "clock": 0.0, "work": 0.0}
HUNG = Scenario("hung", Hung, {"load": [0.1, -0.3], "outside": 1.5}, initial=START, t_end=3, dt=0.01)


@pytest.mark.parametrize("dt", [0.05, 0.5])
def test_both_laws_hold_of_the_whole_and_the_energy_inside_is_what_came_in(dt):
    run = tcbench.simulate("tc_monolithic", HUNG, dt=dt)
    assert run.ok and run.summary.energy_error_max < 1e-13 and run.summary.entropy_increment_min > -1e-15
    z, given = run.scenario.model.state(run.z), supplied(run)
    assert np.allclose(z.clock, run.t, atol=1e-13)
    inside = run.energy - z.work - 1.5 * z.heat
    assert np.allclose(inside - inside[0], given["work"] + given["heat"], atol=1e-13)
    assert abs(given["work"][-1]) > 0.05 and given["heat"][-1] > 0.01


def test_the_supplied_work_is_that_of_a_solver_of_odes():
    """To 1e-12 by methods of high order, and by the second one as its steps shrink."""
    truth = supplied(tcbench.simulate("scipy_dop853", HUNG, tolerance=1e-13))["work"][-1]
    for method, control in (("tc_gauss[k=3]", {"dt": 0.01}), ("tc_auto", {"tolerance": 1e-11})):
        assert supplied(tcbench.simulate(method, HUNG, **control))["work"][-1] == pytest.approx(truth, abs=1e-12)
    work = [supplied(tcbench.simulate("tc_monolithic", HUNG, dt=h))["work"][-1] for h in (0.02, 0.01)]
    assert 3.5 < (work[0] - truth) / (work[1] - truth) < 4.5


@pytest.mark.parametrize("shape", [(), (2,)])
def test_a_force_may_be_a_number_and_one_on_nothing_is_told(shape):
    class Pushed(System):
        name = "pushed"
        variables = {"q": shape, "p": shape} | OUTSIDE
        on = "p"

        def energy(self, z):
            return np.sum(z.p * z.p + z.q * z.q) / 2 + z.work

        def entropy(self, z):
            return 0.0 * z.clock

        def reversible(self, z, dE, dS):
            return driven(dE, {"q": dE.p, "p": -dE.q}, **{self.on: 0.3})

    start = {"q": np.ones(shape), "p": np.zeros(shape), "clock": 0.0, "work": 0.0}
    run = tcbench.simulate("tc_monolithic", Scenario("pushed", Pushed, {}, initial=start, t_end=1.0, dt=0.1))
    z = run.scenario.model.state(run.z)
    path = (z.q[-1] - z.q[0]).sum()
    assert supplied(run)["work"][-1] == pytest.approx(0.3 * path, abs=1e-14) and run.summary.energy_error_max < 1e-14
    with pytest.raises(TcbenchError, match=r"force on 'push', which has no rate: give it .* one of q, p"):
        tcbench.simulate("tc_monolithic", replace(run.scenario, system=type("Lost", (Pushed,), {"on": "push"})))


def test_the_scale_of_energy_errors_does_not_count_the_outside_and_rows_tell_what_came_in():
    """However much work the loads have left, and whatever the entropy of a bath at another temperature."""

    class Warm(Hung):
        reference_temperature = 1.0

    rich = {"work": 1e3, "heat": 1e3}
    for scenario in (HUNG, replace(HUNG, system=Warm)):
        assert scenario.replace(**rich).initial_exergy == pytest.approx(scenario.initial_exergy, rel=0.02)
        run = tcbench.simulate("tc_monolithic", scenario, dt=0.05)
        row, given = metrics.conservation(run), supplied(run)
        assert row["work_supplied"] == given["work"][-1] and row["heat_supplied"] == given["heat"][-1] > 0.01
    assert "work_supplied" not in metrics.conservation(tcbench.simulate("tc_monolithic", "short_term", t_end=0.3))


def test_a_closed_system_has_nothing_supplied():
    with pytest.raises(TcbenchError, match="has no outside"):
        supplied(tcbench.simulate("tc_monolithic", "short_term", t_end=0.3))
