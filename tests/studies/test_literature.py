"""The second ledger: what later authors state, measured as they measure it."""

import numpy as np
import pytest
from tiers import tiers

import tcbench
from tcbench.plugins import by_default, expand_integrators, find_integrator, find_scenario
from tcbench.studies import literature
from tcbench.studies.literature import ADDED, AUTHORS, ERRORS, ORDERS, STEPS, STUDY

# root mean squares of E - E0 at h = 0.1 and at 0.1/1.3^9, by the printed equations in a plain loop
ENERGY = {
    ("ybaby", "gas_containers"): (2.251464e-02, 1.920209e-04),
    ("mybaby", "gas_containers"): (1.447566e-02, 1.233418e-04),
    ("ybaby", "damped_oscillator"): (1.585984e-03, 1.410675e-05),
    ("mybaby", "damped_oscillator"): (7.980794e-04, 7.093250e-06),
}


@pytest.mark.parametrize(("method", "scenario"), tiers(ENERGY, (("ybaby", "damped_oscillator"),)))
def test_the_energy_errors_are_those_of_the_printed_equations(method, scenario):
    found = [
        literature.errors_at(find_integrator(method), find_scenario(scenario), dt) for dt in STEPS[:: len(STEPS) - 1]
    ]
    assert [point["rmse_energy"] for point in found] == pytest.approx(ENERGY[method, scenario], rel=1e-6)


def test_the_ledger_separates_what_is_stated_from_what_is_added():
    cell = STUDY.measure(find_integrator("mybaby"), find_scenario("linear_oscillator"), {})
    tables = STUDY.tabulate([{"integrator": "mybaby", "scenario": "linear_oscillator", **cell}])
    claims, points = tables["literature"], tables["literature_errors"]
    assert set(claims["stated_by"]) == {AUTHORS, ADDED} and (claims["verdict"] == "holds").all()
    assert len(points) == len(STEPS) and np.isfinite(points[list(ERRORS)]).all(axis=None)
    assert (claims["stated_by"] == ADDED).sum() == 2  # E and S beside ybaby


def test_a_method_that_is_no_such_splitting_is_found_out():
    """tc_staggered is of order one, and its area shrinks otherwise than by friction."""
    from dataclasses import replace

    liar = replace(find_integrator("tc_staggered"), name="ybaby")
    pendulum = find_scenario("damped_oscillator").replace(t_end=20.0)
    found = literature.orders(liar, pendulum, [literature.errors_at(liar, pendulum, dt) for dt in STEPS])
    assert not all(f.agrees for f in found)
    assert not literature.area(
        liar, pendulum
    ).agrees  # friction is linear there, too; the map of the step is not Verlet's


def test_a_run_of_everything_has_the_ledger_and_a_selection_what_is_in_it():
    scenarios = [find_scenario(name) for name in STUDY.scenarios]
    assert len(STUDY.plan(expand_integrators(by_default()), scenarios, {})) == len(ORDERS) * len(scenarios)
    assert STUDY.plan([find_integrator("tc_strang")], scenarios, {}) == []
    assert [i.name for i, _, _ in STUDY.plan([find_integrator("mybaby")], scenarios[:1], {})] == ["mybaby"]


def test_a_group_that_could_not_be_measured_keeps_a_row():
    lost = {"integrator": "ybaby", "scenario": "gas_containers", "status": "timeout", "failure": "late"}
    row = STUDY.tabulate([lost])["literature"].iloc[0]
    assert (row.claim, row.verdict, row.why) == ("not measured", "", "late") and "ybaby" in tcbench.integrators()
