"""The measured order is the declared order: against certified states, on a ladder of steps that halve."""

import numpy as np
import pytest

import tcbench
from tcbench import plugins
from tcbench.studies import convergence
from tcbench.studies.convergence import STUDY, groups, measure, plan, step_counts, tabulate

SECOND = ("tc_monolithic", "tc_strang", "midpoint_entropy", "midpoint_temperature")
SCENARIOS = ("short_term", "bound_equilibrium", "stiff_spring")


def orders(integrator, scenario, **options):
    row = measure(plugins.find_integrator(integrator), plugins.find_scenario(scenario), options)
    return {order["variable"]: order for order in row["orders"]}


def made(name="made", order=1, **how):
    return tcbench.Integrator(name=name, order=order, **how)


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("integrator", SECOND)
def test_second_order_methods_are_of_order_two(integrator, scenario):
    """Within 0.03, the demand; the intervals contain 2 (they are a few thousandths wide)."""
    found = orders(integrator, scenario)
    for variable in ("q", "p", "s"):
        fit = found[variable]
        assert fit["order"] == pytest.approx(2, abs=0.03), (variable, fit)
        assert fit["order_low"] <= 2 <= fit["order_high"], (variable, fit)
        assert fit["order_high"] - fit["order_low"] < 0.2
        assert fit["verdict"] == "as declared" and fit["points_used"] >= 4


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_staggered_method_is_of_order_one(scenario):
    found = orders("tc_staggered", scenario)
    for variable in ("q", "p", "s"):
        fit = found[variable]
        assert fit["order"] == pytest.approx(1, abs=0.03), (variable, fit)
        assert fit["order_low"] <= 1 <= fit["order_high"] and fit["verdict"] == "as declared"


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_literal_reading_of_a5_is_of_order_one(scenario):
    """Its error is C h + D h^2 with a small C on bound_equilibrium: there the window starts at small steps."""
    found = orders("midpoint_temperature[reading=a5_literal]", scenario)
    assert found["all"]["order"] == pytest.approx(1, abs=0.03)
    assert found["all"]["verdict"] == "as declared"


@pytest.mark.parametrize("scenario", ("long_term", "relative_equilibrium", "cold_spring", "fast_conduction"))
@pytest.mark.parametrize("integrator", (*SECOND, "tc_staggered"))
def test_the_other_scenarios_show_the_declared_order(integrator, scenario):
    declared = plugins.find_integrator(integrator).order
    fit = orders(integrator, scenario)["all"]
    assert fit["order"] == pytest.approx(declared, abs=0.03) and fit["verdict"] == "as declared"


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


def test_explicit_euler_in_plain_python_is_of_order_one():
    euler = made(step=lambda z, h, system: z + h * np.asarray(system.vector_field(z)))
    row = measure(euler, tcbench.scenarios()["bound_equilibrium"], {})
    fit = {f["variable"]: f for f in row["orders"]}["all"]
    assert fit["order"] == pytest.approx(1, abs=0.03) and max(p["dt"] for p in row["points"]) == 0.5


def test_errors_near_the_reference_are_masked(monkeypatch):
    """With a reference good to 1e-6 only, no error below 1e-5 may enter an order."""
    from dataclasses import replace

    from tcbench.reference import lookup as truth

    original = truth.reference_for
    monkeypatch.setattr(truth, "reference_for", lambda *a: replace(original(*a), floor=(1e-6,)))
    row = measure(plugins.find_integrator("tc_monolithic"), tcbench.scenarios()["short_term"], {})
    small = [p for p in row["points"] if p["error"] <= 1e-5]
    assert small and {p["reason"] for p in small} == {"reference-limited"} and not any(p["used"] for p in small)


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


def test_plan_leaves_adaptive_solvers_out():
    adaptive = tcbench.Integrator(name="adaptive", adaptive=lambda *a: None)
    methods = [adaptive, plugins.find_integrator("tc_strang")]
    cells = plan(methods, list(tcbench.scenarios().values())[:2], {})
    assert [(m.name, o) for m, _, o in cells] == [("tc_strang", {}), ("tc_strang", {})]
    assert plan([adaptive], list(tcbench.scenarios().values()), {}) == []


def test_what_stands_still_has_no_order_and_says_why():
    """Entropies where nothing is conducted; what moves has its order."""
    scenario = tcbench.scenarios()["short_term"].replace(name="adiabatic", conductivity=0.0)
    row = measure(plugins.find_integrator("tc_monolithic"), scenario, {"dt": [0.1, 0.05, 0.025, 0.0125]})
    found = {fit["variable"]: fit for fit in row["orders"]}
    assert found["s"]["verdict"] == "stands still" and "as it should" in found["s"]["note"]
    assert {found[name]["verdict"] for name in ("q", "p", "theta", "all")} == {"as declared"}


def test_groups_are_the_blocks_of_the_state():
    scenario = tcbench.scenarios()["short_term"]
    found = groups(scenario.model, scenario.z0)
    assert {name: len(values) for name, values in found.items()} == {"q": 4, "p": 4, "s": 2, "theta": 2, "all": 10}
    assert found["theta"] == pytest.approx(scenario.temperatures, rel=1e-14)


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
