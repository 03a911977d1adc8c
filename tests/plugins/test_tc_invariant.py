"""tc_invariant keeps invariants that are not quadratic, into equilibrium; and check tells why others do not."""

import numpy as np
import pytest
from conserving import KEPT, LOST, Charge, one

import tcbench
from tcbench.simulation.invariants import lost_in
from tcbench.solver.invariance import to_hold

OF = {scenario.name: scenario for scenario in LOST}
SYSTEMS = [s for s in LOST if s.name != "hypot"]


def departure(run):
    return max(np.ptp(values) for values in run.invariants.values())


@pytest.mark.parametrize("scenario", SYSTEMS, ids=lambda s: s.name)
def test_it_keeps_what_others_lose(scenario):
    plain, kept = (tcbench.simulate(m, scenario) for m in ("tc_monolithic", "tc_invariant"))
    assert plain.ok and kept.ok and departure(plain) > 1e-7 and departure(kept) < 1e-13
    assert kept.summary.energy_error_max < 2e-14 and kept.summary.entropy_increment_min > -1e-15
    assert not lost_in(kept) and kept.integrator.claims == {"energy", "entropy", "angular_momentum"}


@pytest.mark.parametrize(("name", "why"), [("volterra", "not quadratic"), ("arms", "not as invariant as the energy")])
def test_the_cause_is_told(name, why):
    (found,) = lost_in(tcbench.simulate("tc_monolithic", OF[name]))
    assert why in found.why and "tc_invariant keeps it" in found.why


@pytest.mark.parametrize("scenario", [KEPT, OF["hypot"], "heavy_top", "short_term", "four_masses", "reaction"], ids=str)
def test_what_is_kept_anyway_is_left_alone(scenario):
    """Not a number differs from tc_monolithic's; a move would cost, and break constraints."""
    one = tcbench.plugins.find_scenario(scenario) if isinstance(scenario, str) else scenario
    assert not to_hold(one.model.symbolic)
    if not one.model.multipliers:
        plain, kept = (tcbench.simulate(m, one, t_end=1.0).z for m in ("tc_monolithic", "tc_invariant"))
        assert np.array_equal(plain, kept)


def test_what_follows_from_others_is_not_held_twice():
    """Kepler's momentum follows from energy and the Runge-Lenz vector: held as well, it would leave no unique move."""
    assert to_hold(OF["kepler"].model.symbolic) == ("lenz_x", "lenz_y")
    assert departure(tcbench.simulate("tc_invariant", OF["kepler"])) < 1e-13


@pytest.mark.parametrize("name", ["volterra", "angle_beam"])
def test_ten_thousand_steps_into_equilibrium(name):
    scenario = OF[name]
    run = tcbench.simulate("tc_invariant", scenario, t_end=10_000 * scenario.dt, record_every=1000)
    assert run.ok and run.summary.entropy_increment_min > -1e-13
    assert departure(run) < 1e-13 and run.summary.energy_error_max < 1e-12


@pytest.mark.parametrize("name", ["volterra", "attitude"])
def test_order_two(name):
    from tcbench.reference.lookup import reference_for

    scenario = OF[name].replace(t_end=1.0)
    exact = reference_for(scenario, [1.0]).states[0]
    errors = [np.abs(tcbench.simulate("tc_invariant", scenario, dt=h).z[-1] - exact).max() for h in (0.02, 0.01)]
    assert 1.9 < np.log2(errors[0] / errors[1]) < 2.1


def test_at_rest_nothing_moves():
    scenario = one("rest", Charge, {}, {"q": [0.0, 0.0], "v": [0.0, 0.0], "s": 0.0})
    run = tcbench.simulate("tc_invariant", scenario)
    assert run.ok and np.ptp(run.z, axis=0).max() == 0.0


def test_constraints_are_held_beside_invariants():
    run = tcbench.simulate("tc_invariant", OF["bead"])
    assert np.abs(run.scenario.model.constraint_values(run.z)).max() < 1e-14
    large = tcbench.plugins.find_scenario("director_rod")
    with pytest.raises(tcbench.TcbenchError, match="up to 100"):
        tcbench.simulate("tc_invariant", large)


def test_corrections_of_a_large_system_have_the_memory_that_they_write_to():
    from tcbench.solver.implicit_step import compiled_flows

    flows = compiled_flows(tcbench.plugins.find_integrator("tc_invariant").flows, OF["angle_beam"].model.symbolic)
    (correction,) = (k for k in flows if k.mends)
    assert correction.polish.room > 0 and correction.fields["nd"] >= correction.polish.size + correction.polish.room


def test_a_correction_begins_where_those_of_earlier_steps_lead():
    """To a tenth of it; and where nothing is known of them, where the step ended."""
    from tcbench.simulation.compiled_loop import LOOPS
    from tcbench.simulation.prepared import Rules, take
    from tcbench.solver.equations import MOVED
    from tcbench.solver.implicit_step import compiled_flows

    scenario, method = OF["attitude"], tcbench.plugins.find_integrator("tc_invariant")
    ready = take(method, scenario.model, compiled_flows(method.flows, scenario.model.symbolic))
    run = ready.start(scenario, scenario.dt, 21, 1, Rules())
    LOOPS.begin(run)
    LOOPS.march(run, 0, 1)
    assert not run.others[MOVED].any() and run.past[0].any()
    LOOPS.march(run, 1, 20)
    expected = run.others[MOVED].copy()
    LOOPS.march(run, 20, 21)
    assert np.linalg.norm(run.past[0] - expected) < 0.1 * np.linalg.norm(expected)
