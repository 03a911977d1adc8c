"""tc_taylor: its series solve the equations, its steps keep every law, and orders and tolerances are what they say."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_laws import assert_laws
from states import admissible_states
from tcbench_plugins.tc_taylor import lanes
from tcbench_plugins.tc_taylor.method import TaylorMethod, kernels
from tcbench_plugins.tc_taylor.on_arrays import Coefficients
from tcbench_plugins.tc_taylor.series import Normal
from tcbench_plugins.tc_taylor.texts import series_kernels
from tcbench_plugins.tc_taylor.writer import Writer

import tcbench
from tcbench import System, TcbenchError
from tcbench.compiler import derivatives as trace
from tcbench.compiler import ops
from tcbench.compiler.array_mesh import Mesh, alone
from tcbench.compiler.array_orders import Orders, orders_kernel
from tcbench.compiler.arrays import total, variable
from tcbench.compiler.kernels import kernel, namespace, of_lines
from tcbench.plugins import find_integrator, find_scenario
from tcbench.reference.lookup import reference_for

from ..helpers.networks import NETWORKS

SCENARIOS = ("short_term", "bound_equilibrium", "stiff_spring", "cold_spring", "gas_containers")
FUNCTIONS = {
    "product": lambda m, y: y * y * (1 + y),
    "quotient": lambda m, y: (1 + y) / (2 + y * y),
    "log": lambda m, y: m.log(2 + y * y) * y,
    "log of a quotient": lambda m, y: m.log((2 + y) / (3 - y)) + m.log((y - 4) * (y - 3)) * y,
    "exp": lambda m, y: m.exp(-y * y / 2),
    "sqrt": lambda m, y: m.sqrt(1 + y * y),
    "sin and cos": lambda m, y: m.sin(2 * y) - m.cos(y) * y,
    "tan": lambda m, y: m.tan(y) + 0.5,
    "tanh": lambda m, y: m.tanh(y) + 0.5,
    "sinh and cosh": lambda m, y: m.sinh(y) * m.cosh(y) + 0.3,
    "arcsin and arccos": lambda m, y: m.arcsin(y / 3) * m.arccos(y / 2) + 0.5,
    "hypot": lambda m, y: m.hypot(y, 2 + y),
    "atan": lambda m, y: m.arctan(2 * y) + 0.5,
    "atan2": lambda m, y: m.arctan2(1 + y * y, y) * m.arctan2(y - 2, -y),
    "expm1 and log1p": lambda m, y: m.expm1(-y) + m.log1p(y * y) + 0.3,
    "powers": lambda m, y: (1 + y * y) ** 1.5 / (1 + y) ** 2 + (2 + y) ** 0.3 * 1.5 ** y,
    "absolute value": lambda m, y: abs(y - 1) * y + abs(y + 0.1) ** 1.5,
    "cancelling": lambda m, y: y * (1 / y + y) / (3 + y),
}  # fmt: skip
OTHER_NAMES = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2"}  # of mpmath


class Precise:
    """What numpy has, of 50 digits."""

    def __getattr__(self, name):
        return getattr(mpmath, OTHER_NAMES.get(name, name))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_coefficients_of_each_operation_are_those_of_fifty_digits(name):
    """y' = f(y): coefficient n + 1 of y is coefficient n of f of the polynomial up to y^n, over n + 1."""
    f, order = FUNCTIONS[name], 8
    y = trace.variable("y")
    normal = Normal([y])
    (variable,) = normal.variables
    (rate,) = normal.of([f(np, y)])
    rate = normal.single(rate)
    writer = Writer([variable], {0: rate})
    stored = [f"out[{k}] = {writer.coefficient(variable, k)}" for k in range(order + 1)]
    found = of_lines([*writer.lines, *stored], order + 1)(np.array([0.4]), np.zeros(1))
    on_arrays = Coefficients([y], [rate])
    others = kernel({y: "a[0]"}, [on_arrays.of(variable, k) for k in range(order + 1)])(np.array([0.4]), np.zeros(1))
    looped = looped_series(f, order)
    with mpmath.workdps(50):
        exact = [mpmath.mpf(0.4)]
        for n in range(order):
            of_f = mpmath.taylor(lambda t: f(Precise(), sum(c * t**k for k, c in enumerate(exact))), 0, n)
            exact.append(of_f[n] / (n + 1))
    largest = max(abs(float(c)) for c in exact)
    for each in (found, others, *looped.T):
        assert each == pytest.approx([float(c) for c in exact], rel=1e-13, abs=1e-15 * largest)


def looped_series(f, order):
    """The same by a loop over the orders, of six entries and of a number; shape (order + 1, 7)."""
    y = [variable("y", "entry"), variable("x", "")]
    normal = Normal(y)
    rate = [normal.single(form) for form in normal.of([f(np, x) for x in y])]
    found = Coefficients(y, rate)
    following, kept = found.looped(normal.variables)
    values = *([found.of(x, n) for x in normal.variables] for n in range(2)), following
    orders = Orders(order, found.k, kept, alone(y), [], values, [], ([], []))
    made = orders_kernel({"a": alone(y)}, orders).kernel(Mesh({"entry": 6}, {}))
    return made(np.full(7, 0.4), np.zeros(1)).reshape(order + 1, 7)


def test_every_function_of_formulas_is_among_them():
    y = trace.variable("y")
    assert {x.op for x in trace.topological(f(np, y) for f in FUNCTIONS.values())} >= set(ops.functions())


@pytest.mark.parametrize("name", ["shared_bath", "reactions", "net[nx=3,ny=3]"])
def test_on_arrays_it_is_what_it_is_entry_by_entry_and_keeps_every_law(name, monkeypatch):
    scenario = NETWORKS.get(name) or find_scenario(name)
    times, found, costs = np.linspace(0.0, 0.06, 4), [], set()
    for most in (0, 1000):
        monkeypatch.setattr("tcbench_plugins.tc_taylor.orders.MOST_ELEMENTS", most)
        monkeypatch.setattr("tcbench_plugins.tc_taylor.orders.MOST_VARIABLES", most)
        fresh = scenario.replace(name=f"{name} {most}")
        method = TaylorMethod(fresh.model, 4)
        found.append(method.adaptive(scenario.z0, times, 1e-6))
        costs.add(method.series_time)
        if most == 0:
            run = tcbench.simulate("tc_taylor[order=4]", fresh, dt=0.02, t_end=0.2)
            assert run.ok and run.summary.energy_error_max < 1e-13 and run.summary.entropy_increment_min > 0.0
            assert all(error < 1e-12 for error in run.summary.invariant_error_max.values())
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-13 and found[0][1] == found[1][1]
    assert len(costs) == 2  # they are two


def test_the_logarithm_of_a_product_of_different_signs_is_no_number():
    """Though it is that of the sizes of both: a step that ends there is refused."""
    x, y = trace.variables("y", 2)
    normal = Normal([x, y])
    rate = [normal.single(form) for form in normal.of([(x * y).log(), (y / x).log()])]
    writer = Writer(normal.variables, dict(enumerate(rate)))
    stored = [f"out[{i}] = {writer.coefficient(variable, 1)}" for i, variable in enumerate(normal.variables)]
    in_lanes = of_lines([*writer.lines, *stored], 2)
    on_arrays = Coefficients([x, y], rate)
    as_arrays = kernel({x: "a[0]", y: "a[1]"}, [on_arrays.of(variable, 1) for variable in normal.variables])
    for first in (in_lanes, as_arrays):
        for signs in ((1.0, 1.0), (-1.0, -1.0)):
            found = first(np.array([0.4, 3.0]) * signs, np.zeros(1))
            assert found == pytest.approx([np.log(1.2), np.log(7.5)], rel=1e-14)
        assert np.isnan(first(np.array([0.4, -3.0]), np.zeros(1))).all()


@pytest.mark.parametrize("name", ["stiff_spring", "gas_containers"])
def test_the_series_starts_with_the_rates_and_solves_the_equations(name):
    scenario = tcbench.scenarios()[name]
    method = TaylorMethod(scenario.model, 12)
    made, *_ = kernels(scenario.model.symbolic, 12)
    series, polynomial = made["to_series"], made["to_state"]
    y = np.asarray(scenario.model.temperature_variables(scenario.z0))
    coefficients = series(y, method.work.given)
    table = coefficients[:-2].reshape(13, -1)
    field = np.asarray(scenario.model.temperature_field(y))
    assert np.allclose(table[1], field, rtol=1e-13, atol=1e-13 * abs(field).max())
    assert coefficients[-2:] == pytest.approx([np.sum(table[k] ** 2 / (1 + y**2)) for k in (11, 12)], rel=1e-13)
    h = 0.1 * (1e-16 / coefficients[-1]) ** (1 / 24)
    rate = sum(k * table[k] * h ** (k - 1) for k in range(1, 13))
    there = np.asarray(scenario.model.temperature_field(polynomial(coefficients, np.array([h]))))
    assert np.allclose(rate, there, rtol=1e-11, atol=1e-11 * abs(there).max())


@pytest.mark.parametrize("name", ["stiff_spring", "gas_containers", "chain[n=3]"])
def test_lanes_change_nothing_but_round_off_and_plain_python_agrees(name, monkeypatch):
    system, order = find_scenario(name).model, 10
    y = np.asarray(system.temperature_variables(find_scenario(name).z0))
    y = y * (1.0 + 0.1 * np.random.default_rng(2009).random(len(y)))
    found = []
    for width in (4, 1):
        monkeypatch.setattr(lanes, "WIDTH", width)
        series, _, _, more, _ = series_kernels(system, order, len(system.constant_values))
        setup = kernel(system.constant_symbols(), more)(system.constant_values, system.constant_values)
        given = np.concatenate([system.constant_values, setup])
        found.append(series(y, given)[:-2].reshape(order + 1, -1))
        assert ("row(a" in series.text) == (width > 1)
        scope, out = dict(namespace()), np.empty(series.size)
        exec(series.text, scope)
        scope["kernel"](y, given, out)
        found.append(out[:-2].reshape(order + 1, -1))
    largest = abs(found[0]).max(axis=1, keepdims=True)  # what cancels is known to the round-off of what it is made of
    for other in found[1:]:
        assert np.all(abs(other - found[0]) <= 1e-12 * largest)


@settings(max_examples=30)
@given(admissible_states(), st.sampled_from([-12, -8, -4, -1]))
def test_every_law_holds_from_random_states_at_any_tolerance(state, exponent):
    assert_laws("tc_taylor", state, 3.0, 10.0**exponent)


@pytest.mark.parametrize("name", SCENARIOS)
def test_errors_follow_the_tolerance(name):
    scenario = tcbench.scenarios()[name]
    reference = reference_for(scenario, [1.0]).states[-1].astype(float)
    solve = find_integrator("tc_taylor").adaptive
    errors = []
    for tolerance in (1e-4, 1e-8, 1e-12):
        states, counts = solve(scenario.model, scenario.z0, np.array([0.0, 1.0]), tolerance, tolerance)
        errors.append(np.max(np.abs(states[-1] - reference) / np.maximum(1.0, np.abs(reference))))
        # errors grow by the scenario's own sensitivity: at most 2000-fold to t = 1 on cold_spring
        assert errors[-1] <= 3e3 * tolerance + 1e-12 and counts["steps"] >= 1
    assert errors[2] < errors[0]


@pytest.mark.parametrize("order", [2, 4])
def test_fixed_steps_have_the_order_that_they_declare(order):
    scenario = tcbench.scenarios()["bound_equilibrium"].replace(conductivity=1.0, t_end=1.0)
    exact = tcbench.simulate("tc_taylor", scenario, tolerance=1e-14).z[-1]
    steps = (64, 128)
    errors = [
        abs(tcbench.simulate(f"tc_taylor[order={order}]", scenario, dt=1.0 / n).z[-1] - exact).max() for n in steps
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


def test_states_on_the_way_are_those_of_the_run_and_keep_the_laws():
    """Output times cost no steps, and every state that is shown is mended."""
    scenario = tcbench.scenarios()["bound_equilibrium"]
    solve = find_integrator("tc_taylor").adaptive
    few, cost = solve(scenario.model, scenario.z0, np.array([0.0, 5.0]), 1e-9, 1e-9)
    many, more = solve(scenario.model, scenario.z0, np.linspace(0.0, 5.0, 1001), 1e-9, 1e-9)
    assert more["steps"] == cost["steps"] and np.abs(few[-1] - many[-1]).max() < 1e-9
    energy, entropy = scenario.model.energy(many), many[:, -2:].sum(axis=1)
    assert np.ptp(energy) <= 1e-12 * scenario.initial_exergy and np.diff(entropy).min() >= -4e-16


class Still(System):
    name = "still"
    variables = {"x": (101,)}

    def energy(self, z):
        return z.x @ z.x

    def entropy(self, z):
        return z.x.sum()


def test_what_has_no_series_or_is_too_large_is_refused_with_a_sentence():
    y = variable("y", "cell")
    with pytest.raises(TcbenchError, match="no series of the operation 'max'"):
        Normal([y]).of([total("max", y, "cell")])
    for name in ("tc_taylor", "tc_taylor[order=8]"):  # said before anything runs
        assert "101 variables out, which are too many" in find_integrator(name).suits(Still())
    assert find_integrator("tc_auto").suits(Still()) == ""
