"""The state of largest entropy of any system: where consistent runs end, and what the study says of others."""

import numpy as np
import pytest
from mechanics import Mechanical
from tiers import tiers

import tcbench
from tcbench.analysis.maximum_entropy import maximum_entropy
from tcbench.plugins import find_integrator
from tcbench.studies import equilibrium
from tcbench.studies.equilibrium import measure, tabulate

SCENARIOS = tcbench.scenarios()
BOUND = ("damped_oscillator", "rubbing_piston", "rigid_body", "heavy_top", "reaction", "gas_containers")


@pytest.mark.parametrize("name", tiers(BOUND, ("damped_oscillator", "rubbing_piston")))
def test_exact_runs_end_there_from_below(name):
    scenario = SCENARIOS[name]
    exact = maximum_entropy(scenario.model, scenario.z0)
    run = tcbench.simulate("tc_taylor", scenario, tolerance=1e-9, t_end=2000.0)
    assert run.ok and exact.entropy - run.entropy[0] > 0
    assert exact.entropy == pytest.approx(run.entropy[-1], abs=1e-8)
    assert exact.temperatures == pytest.approx(run.temperatures[-1], rel=1e-3)
    here = scenario.model.observe(exact.z)
    assert here[[0, *range(2, 2 + len(scenario.model.invariant_names))]] == pytest.approx(
        [run.energy[0], *(values[0] for values in run.invariants.values())], rel=1e-10, abs=1e-10
    )


def test_springs_that_expand_for_ever_have_none():
    found = maximum_entropy(SCENARIOS["short_term"].model, SCENARIOS["short_term"].z0)
    assert not found.exists and np.isnan(found.entropy) and "100 times as large" in found.note


def test_what_is_found_is_held_for_all_and_cannot_be_written_to():
    scenario = SCENARIOS["gas_containers"]
    found = maximum_entropy(scenario.model, scenario.z0)
    assert found is maximum_entropy(scenario.model, scenario.z0)
    for values in (found.z, found.temperatures):
        with pytest.raises(ValueError, match="read-only"):
            values[...] = 0.0


class Two(Mechanical):
    """Two masses on springs with baths of their own; the second feels no friction."""

    name = "two"
    variables = {"q": (2,), "p": (2,), "s": ()}

    def energy(self, z):
        return (z.p @ z.p + z.q @ z.q) / 2 + np.exp(z.s)

    def irreversible(self, z, dE, dS):
        return {"p": np.array([-0.5 * dE.p[0], 0]), "s": 0.5 * dE.p[0] ** 2 / dE.s}


def told(method, scenario, **options):
    found = measure(find_integrator(method), scenario, options or {"dt": scenario.dt})
    return {"integrator": method, "scenario": scenario.name} | found


def test_a_run_that_rests_below_is_told_what_may_be_missing():
    scenario = tcbench.Scenario("two", Two, {}, initial={"q": [0, 0], "p": [1, 1], "s": 0}, t_end=60, dt=0.1)
    summary = told("tc_strang", scenario)["summary"]
    assert summary["equilibrium"] == "not reached" and "something is conserved that invariants()" in summary["note"]
    assert summary["entropy_gap"] == pytest.approx(np.log(2) - np.log(1.5), rel=1e-3)


def test_the_study_tells_any_system_in_its_own_columns():
    records = [told("tc_strang", SCENARIOS[n], dt=SCENARIOS[n].dt) for n in ("rubbing_piston", "rigid_body")]
    assert [r["summary"]["equilibrium"] for r in records] == ["approached", "approached"]
    tables = tabulate(records)
    for table in tables.values():
        assert not [c for c in table if c.startswith(("strain", "growth", "rotation", "exact_strain", "rate"))]
    assert "temperature_gap" in tables["equilibrium"] and "temperature_gap" not in tabulate(records[1:])["equilibrium"]
    assert tables["equilibrium_summary"]["note"].str.contains("found at its energy and invariants").all()


def test_systems_that_are_too_large_are_left_out():
    methods = [find_integrator("tc_strang")]
    chosen = [tcbench.plugins.find_scenario("chain[n=40]"), SCENARIOS["reaction"]]
    assert [s.name for _, s, _ in equilibrium.plan(methods, chosen, {})] == ["reaction"]


class Wells(Mechanical):
    """Two wells, one lower: the nearest equilibrium is not the one of largest entropy."""

    name, variables, constants = "wells", {"q": (), "p": (), "s": ()}, {"tilt": (), "far": ()}

    def energy(self, z):
        return z.p**2 / 2 + ((z.q / self.far) ** 2 - 1) ** 2 / 4 + self.tilt * z.q + np.exp(z.s)

    def irreversible(self, z, dE, dS):
        return {"p": -0.1 * dE.p, "s": 0.1 * dE.p**2 / dE.s}


@pytest.mark.parametrize("far", [1.0, 0.6, 1.7])
@pytest.mark.parametrize("tilt", [0.03, 0.1, 0.2])
def test_the_largest_entropy_is_looked_for_behind_hills(tilt, far):
    """A local maximum (0.008 for 0.207) was called the largest that energy and invariants allow."""
    system, z0 = Wells(tilt=tilt, far=far), np.array([1.05 * far, 0.1, 0.0])
    q = np.linspace(-3 * far, 3 * far, 400_001)
    heat = float(system.energy(z0)) - ((q / far) ** 2 - 1) ** 2 / 4 - tilt * q
    assert maximum_entropy(system, z0).entropy == pytest.approx(np.log(heat[heat > 0].max()), abs=1e-8)
