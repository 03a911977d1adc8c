"""The measured order is the declared order: against certified states, on a ladder of steps that halve."""

import numpy as np
import pytest
from tiers import tiers

import tcbench
from tcbench import plugins
from tcbench.reference import certified
from tcbench.studies import convergence
from tcbench.studies.convergence import STUDY, measure, step_counts, tabulate

SECOND = ("tc_monolithic", "midpoint_entropy", "midpoint_temperature")


def orders(integrator, scenario, **options):
    row = measure(plugins.find_integrator(integrator), plugins.find_scenario(scenario), options)
    return {order["variable"]: order for order in row["orders"]}


def made(name="made", order=1, **how):
    return tcbench.Integrator(name=name, order=order, **how)


PAIRS = [(name, "short_term") for name in (*SECOND, "tc_staggered", "midpoint_temperature[reading=a5_literal]")]
PAIRS += [("tc_strang", name) for name in certified.stored_file()["scenarios"]] + [("tc_staggered", "stiff_spring")]


@pytest.mark.parametrize(("integrator", "scenario"), tiers(PAIRS, PAIRS[:2] + PAIRS[5:6]))
def test_the_measured_order_is_the_declared_one_in_each_variable(integrator, scenario):
    """Within 0.03, the demand; the intervals contain it, and are a few thousandths wide."""
    declared, found = plugins.find_integrator(integrator).order, orders(integrator, scenario)
    for variable in ("q", "p", "s", "all"):
        fit = found[variable]
        assert fit["order"] == pytest.approx(declared, abs=0.03) and fit["verdict"] == "as declared", (variable, fit)
        assert fit["order_low"] <= declared <= fit["order_high"] < fit["order_low"] + 0.2 and fit["points_used"] >= 4


def test_a_wrong_declaration_is_found_out():
    """tc_staggered under the flag of order 2, and midpoint_entropy under that of order 1."""
    staggered = plugins.find_integrator("tc_staggered").flows
    row = measure(made(order=2, flows=list(staggered)), tcbench.scenarios()["short_term"], {})
    assert {fit["verdict"] for fit in row["orders"]} == {"lower than declared"}
    midpoint = plugins.find_integrator("midpoint_entropy").flows
    row = measure(made(order=1, flows=list(midpoint)), tcbench.scenarios()["short_term"], {})
    assert {fit["verdict"] for fit in row["orders"]} == {"higher than declared"}


def wrong_field(z, h, system):
    """Converges, but to the solution of other equations: a plateau of errors."""
    return z + 1.01 * h * np.asarray(system.vector_field(z))


def noisy(z, h, system):
    """Each step leaves the same error however small it is: the sum grows as 1/h."""
    return z + h * np.asarray(system.vector_field(z)) + 1e-6


def unstable(z, h, system):
    """A parasitic growth of 5 % a step."""
    return z + h * np.asarray(system.vector_field(z)) + 0.05 * z


@pytest.mark.parametrize("step", (wrong_field, noisy, unstable), ids=lambda f: f.__name__)
def test_a_method_that_diverges_shows_no_positive_order(step):
    row = measure(made(step=step), tcbench.scenarios()["bound_equilibrium"], {})
    for fit in row["orders"]:
        assert np.isnan(fit["order"]) and fit["verdict"] == "undetermined", fit
    assert not any(point["used"] for point in row["points"])


def test_a_method_that_always_fails_is_a_row_with_a_reason():
    def broken(z, h, system):
        raise ValueError("no such step")

    row = measure(made(step=broken), tcbench.scenarios()["short_term"], {})
    assert row["status"] == "exception"
    assert {point["reason"] for point in row["points"]} == {"failed"}
    assert all("no such step" in point["failure"] for point in row["points"])
    assert {fit["verdict"] for fit in row["orders"]} == {"undetermined"}


def test_a_wrong_reference_is_not_mistaken_for_order_two(monkeypatch):
    """Broken on purpose: states moved by 1e-5, and the errors end on a plateau, which is no order."""
    from dataclasses import replace

    from tcbench.reference import lookup as truth

    original = truth.reference_for

    def moved(*arguments):
        reference = original(*arguments)
        return replace(reference, states=reference.states + 1e-5)

    monkeypatch.setattr(truth, "reference_for", moved)
    found = orders("tc_monolithic", "short_term")
    assert all(np.isnan(found[name]["order"]) for name in ("q", "p", "s", "all"))


def test_steps_of_the_user_are_rounded_to_divisors_of_the_convergence_time():
    scenario, method = tcbench.scenarios()["short_term"], plugins.find_integrator("tc_monolithic")
    assert step_counts(method, scenario, [0.3, 0.1, 0.0999]) == [3, 10]
    row = measure(method, scenario, {"dt": [0.01, 0.02, 0.03, 0.005, 0.0025]})
    dt = sorted({point["dt"] for point in row["points"]})
    assert dt == [1 / 400, 1 / 200, 1 / 100, 1 / 50, 1 / 33]
    assert {f["variable"]: f for f in row["orders"]}["all"]["order"] == pytest.approx(2, abs=0.1)


def test_what_stands_still_has_no_order_and_says_why():
    """Entropies where nothing is conducted; what moves has its order."""
    scenario = tcbench.scenarios()["short_term"].replace(name="adiabatic", conductivity=0.0)
    row = measure(plugins.find_integrator("tc_monolithic"), scenario, {"dt": [0.1, 0.05, 0.025, 0.0125]})
    found = {fit["variable"]: fit for fit in row["orders"]}
    assert found["s"]["verdict"] == "stands still" and "as it should" in found["s"]["note"]
    assert {found[name]["verdict"] for name in ("q", "p", "theta", "all")} == {"as declared"}


def test_tables_are_tidy_and_a_failed_cell_keeps_a_row():
    method, scenario = plugins.find_integrator("tc_strang"), tcbench.scenarios()["bound_equilibrium"]
    good = {"integrator": "tc_strang", "scenario": scenario.name} | measure(method, scenario, {})
    bad = {"integrator": "worse", "scenario": scenario.name, "status": "timeout", "failure": "took too long"}
    tables = tabulate([bad, good])
    assert set(tables) == set(STUDY.table_names)
    fits, points = tables["convergence"], tables["convergence_points"]
    assert list(fits.columns[: len(convergence.CONVERGENCE.names)]) == convergence.CONVERGENCE.names
    assert list(points.columns) == convergence.POINTS.names
    assert list(fits.integrator) == ["tc_strang"] * 5 + ["worse"]
    assert len(points) == 5 * len(convergence.HALVINGS)
    last = fits.iloc[-1]
    assert (last.status, last.note, last.verdict) == ("timeout", "took too long", "undetermined")
    used = points[(points.variable == "q") & points.used]
    fit = fits[fits.variable == "q"].iloc[0]
    assert len(used) == fit.points_used and used.dt.min() == fit.dt_min and used.dt.max() == fit.dt_max
