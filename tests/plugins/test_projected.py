"""verlet_heat4 and the complex numbers it steps through; the thermodynamic projection around flows and steps."""

import cmath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tcbench_plugins.projected import onto_laws, projected

import tcbench
from tcbench.compiler import derivatives as trace
from tcbench.compiler.complex_symbols import Complex
from tcbench.compiler.kernels import kernel
from tcbench.errors import TcbenchError
from tcbench.integrator import Flow, Integrator
from tcbench.plugins import find_integrator
from tcbench.reference.lookup import reference_for

# conduction slow enough that these steps resolve it
SLOW = tcbench.scenarios()["short_term"].replace(name="slow_heat", conductivity=1.0, t_end=1.0)
positive = st.builds(complex, st.floats(0.2, 3), st.floats(-2, 2))
any_number = st.builds(complex, st.floats(-3, 3), st.floats(-2, 2))


def evaluated(formula, *numbers):
    """A formula of Complex, compiled, at complex numbers."""
    symbols = [(trace.variable("re"), trace.variable("im")) for _ in numbers]
    result = formula(*(Complex(*pair) for pair in symbols))
    inputs = {x: f"a[{i}]" for i, x in enumerate(x for pair in symbols for x in pair)}
    parts = [part for z in numbers for part in (z.real, z.imag)]
    return complex(*kernel(inputs, [result.re, result.im])(np.array(parts), np.zeros(1)))


def close(found, expected):
    return abs(found - expected) <= 1e-13 * max(1.0, abs(expected))


@pytest.mark.parametrize(
    ("ours", "exact"),
    [
        (lambda z: z.exp(), cmath.exp), (lambda z: z.log(), cmath.log), (lambda z: z.sqrt(), cmath.sqrt),
        (lambda z: z**3, lambda z: z**3), (lambda z: z**-1.5, lambda z: z**-1.5), (lambda z: 2.0 / z, lambda z: 2 / z),
        (lambda z: (z - 0.7).expm1(), lambda z: cmath.exp(z - 0.7) - 1),
        (lambda z: (z - 0.7).log1p(), lambda z: cmath.log(z + 0.3)),
    ],
)  # fmt: skip
def test_functions_of_complex_symbols(ours, exact):
    given(positive)(lambda z: None if close(evaluated(ours, z), exact(z)) else pytest.fail(f"{z}"))()


@given(any_number, positive)
def test_arithmetic_of_complex_symbols(x, y):
    formula = lambda a, b: (a * b - 2.0 * a) / b + (1.0 - a) - (-b) + 3j * b  # noqa: E731
    assert close(evaluated(formula, x, y), formula(x, y))


def plain_verlet(z, h, model):
    """Increments of verlet_heat for the pendulum in plain numpy, complex h and all."""
    C, beta, c0, ref, kappa = (
        model.stiffness, model.coupling, model.heat_capacity, model.reference_temperature, model.conductivity,
    )  # fmt: skip

    def kick(q, s, tau):
        r = np.array([q[:2], q[2:] - q[:2]])
        pi = (r * r).sum(axis=1)
        L = 0.5 * np.log(pi) - np.log(model.natural_lengths)
        theta = ref * np.exp((s - beta * L) / c0)
        a = 2 * kappa * tau / c0
        u, w = theta.sum() / 2, (theta[0] - theta[1]) / 2
        mean = np.array([u, u]) + np.array([1, -1]) * w * (1 - np.exp(-a)) / a
        stress = (C * L - beta * (mean - ref)) / (2 * pi)
        pull = 2 * stress[:, None] * r
        new = np.array([u, u]) + np.array([1, -1]) * w * np.exp(-a)
        return tau * np.concatenate([pull[1] - pull[0], -pull[1]]), c0 * np.log(new / theta)

    q, p, s = z[:4], z[4:8], z[8:]
    dp0, ds0 = kick(q, s, h / 2)
    drift = h * (p + dp0) / model.inertia()
    dp1, ds1 = kick(q + drift, s + ds0, h / 2)
    return np.concatenate([drift, dp0 + dp1, ds0 + ds1])


@pytest.mark.parametrize("scenario", ["short_term", "bound_equilibrium"])
def test_verlet_heat4_is_the_real_part_of_two_complex_steps(scenario):
    scenario = tcbench.scenarios()[scenario]
    z, h, gamma = scenario.z0.astype(complex), 0.02, 0.5 + 1j * 3**0.5 / 6
    first = plain_verlet(z, gamma.conjugate() * h, scenario.model)
    expected = (first + plain_verlet(z + first, gamma * h, scenario.model)).real
    run = tcbench.simulate("verlet_heat4", scenario, dt=h, t_end=h)
    np.testing.assert_allclose(run.z[-1] - run.z[0], expected, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("name", ["verlet_heat4", "projected", "projected[method=gauss2]"])
def test_orders(name):
    exact = reference_for(SLOW, [1.0]).states[0].astype(float)
    errors = [np.abs(tcbench.simulate(name, SLOW, dt=1 / n).z[-1] - exact).max() for n in (64, 128)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(find_integrator(name).order, abs=0.1)


BASES = ["verlet_heat", "midpoint_temperature", "gauss2", "tc_gauss"]


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("scenario", ["short_term", "bound_equilibrium", "stiff_spring"])
def test_projected_methods_obey_the_laws(base, scenario):
    scenario = tcbench.scenarios()[scenario]
    run = tcbench.simulate(projected(find_integrator(base)), scenario, dt=0.02, t_end=20.0)
    assert run.status == "ok"
    assert run.summary.energy_error_max <= 2e-12  # 2^-48 of E, 1.2e-12 of the exergy, is left alone
    assert run.summary.entropy_increment_min >= -1e-13
    assert run.summary.invariant_error_max["angular_momentum"] <= 1e-12 * max(1.0, abs(run.angular_momentum[0]))


@pytest.mark.parametrize("grown", [1.01, 0.99])
def test_the_entropy_is_held_where_it_would_fall(grown):
    scenario = tcbench.scenarios()["short_term"]
    model, z0 = scenario.model, scenario.z0
    end = z0.copy()
    end[4:8] = grown * end[4:8] + np.array([0.0, 1e-3, 0.0, 0.0])  # more or less kinetic energy, other momenta
    fixed = onto_laws(model, z0, end)
    assert model.energy(fixed) == pytest.approx(float(model.energy(z0)), rel=1e-14)
    assert model.momenta(fixed) == pytest.approx(model.momenta(z0), rel=1e-14)
    risen = float(model.entropy(fixed) - model.entropy(z0))
    assert abs(risen) <= 1e-14 if grown > 1 else risen > -1e-14
    assert np.linalg.norm(fixed - end) <= 2 * np.linalg.norm(end - z0)


def to_sphere(part):
    """Of a rigid body: that part of the way onto the sphere of its angular momentum, and no thought for the energy."""

    def formula(z0, z1, h, system, start, first, moved):
        x, there = np.asarray(z0), np.asarray(first)
        return z1 - z0 - part * (np.sqrt((there @ there) / (x @ x)) - 1.0) * x

    return Flow(formula, of_step=True, most=10)


@pytest.mark.parametrize(("part", "status"), [(1.0, "ok"), (0.9, "ok"), (0.5, "nonfinite"), (0.0, "nonfinite")])
def test_an_explicit_formula_is_applied_until_the_state_has_the_laws(part, status):
    """At every step; of one that moves nothing, or too little, the first step fails."""
    grown = Flow(lambda z0, z1, h, system: z1 - 1.001 * z0)  # along the state: of its energy and its invariant
    method = Integrator(name="grown", order=1, flows=[grown, to_sphere(part)])
    run = tcbench.simulate(method, "rigid_body", dt=0.1, t_end=1.0)
    assert run.status == status and run.steps == (10 if status == "ok" else 0)
    assert status != "ok" or np.abs(run.z - run.z[0]).max() <= 1e-12


@pytest.mark.parametrize("of_step", [True, False])
def test_formulas_that_would_be_applied_once_are_refused(of_step):
    """Only what ends a step is applied until the state has the laws."""
    flows = [Flow(to_sphere(1.0).residual, of_step=of_step, most=10), lambda z0, z1, h, system: z1 - z0]
    with pytest.raises(TcbenchError, match="most= is of the last formula alone, of the whole step"):
        Integrator(name="twice", order=1, flows=flows if of_step else flows[:1])


def test_where_no_state_is_near_the_step_fails():
    """What came before has the laws, even where the method alone blows up."""
    run = tcbench.simulate("projected", "stiff_spring", dt=0.2)
    assert run.status == "nonfinite" and run.steps >= 1
    assert run.summary.energy_error_max <= 1e-12 and run.summary.entropy_increment_min >= -1e-13
    assert run.summary.invariant_error_max["angular_momentum"] <= 1e-12 * abs(run.angular_momentum[0])


@pytest.mark.parametrize(
    ("base", "name"), [("gauss2", "damped_oscillator"), *(("midpoint_entropy", x) for x in ("rigid_body", "reaction"))]
)
def test_systems_without_elements(base, name):
    """Every law, and the order of the method; one that keeps the energy by itself is none of those to be projected."""
    scenario = tcbench.scenarios()[name].replace(t_end=2.0)
    method = projected(find_integrator(base))
    run = tcbench.simulate(method, scenario, dt=0.1, t_end=60.0)
    assert run.ok and run.summary.energy_error_max <= 1e-13 and run.summary.entropy_increment_min >= -1e-14
    assert max(run.summary.invariant_error_max.values(), default=0.0) <= 1e-13
    exact = tcbench.simulate("solve_ivp_dop853", scenario, tolerance=1e-13).z[-1]
    errors = [np.abs(tcbench.simulate(method, scenario, dt=h).z[-1] - exact).max() for h in (0.1, 0.05)]
    assert errors[1] < 1e-12 or np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.3)


def with_a_number(z0, z1, h, system, numbers):
    """The midpoint rule, moved along the slope of the energy so far that this is kept."""
    slope = system.gradient((z0 + z1) / 2)
    rows = z1 - z0 - h * system.vector_field((z0 + z1) / 2) - numbers["share"] * slope
    return rows, [system.energy(z1) - system.energy(z0)]


def test_a_formula_may_solve_for_numbers_of_its_own():
    method = Integrator(name="own", order=2, flows=[Flow(with_a_number, numbers=("share",))])
    scenario = tcbench.scenarios()["damped_oscillator"]
    run, plain = (tcbench.simulate(m, scenario, dt=0.1) for m in (method, "midpoint_entropy"))
    assert run.ok and run.summary.energy_error_max < 1e-13 < plain.summary.energy_error_max
    assert 0 < np.abs(run.z - plain.z).max() < 1e-2


def euler(z, h, system):
    return z + h * np.asarray(system.vector_field(z))


def marching(rows):
    """Euler's step and a loop of its own, which gives states or increments."""

    def march(z, h, count, system):
        found = [np.asarray(z)]
        for _ in range(count):
            found.append(np.asarray(euler(found[-1], h, system)))
        return np.array(found[1:]) if rows == "states" else np.diff(found, axis=0)

    def increment(z, h, system):
        return euler(z, h, system) - z

    given = {"step": euler} if rows == "states" else {"step": increment, "increments": True}
    return Integrator(name="euler", order=1, source="x", march=march, **given)


@pytest.mark.parametrize("rows", ["states", "increments"])
@pytest.mark.parametrize("times", [1, 2])
def test_a_method_that_marches_by_itself_is_projected_at_every_step(rows, times):
    method = marching(rows)
    for _ in range(times):
        method = projected(method)
    run, plain = (tcbench.simulate(m, SLOW, dt=0.01) for m in (method, projected(Integrator(
        name="plain", order=1, source="x", step=euler))))  # fmt: skip
    assert run.status == "ok" and run.summary.energy_error_max <= 1e-12
    np.testing.assert_allclose(run.z, plain.z, rtol=0, atol=1e-11)


def test_what_can_be_projected():
    with pytest.raises(TcbenchError, match="multistep method"):
        projected(Integrator(name="two", order=2, memory=1, starter="tc_monolithic", flows=lambda *z: z[1] - z[0]))
    with pytest.raises(TcbenchError, match="tc_gauss_adaptive"):
        find_integrator("projected[method=tc_gauss_adaptive]")  # it keeps the energy already
    assert {"midpoint_entropy", "gauss3"} <= set(find_integrator("projected").parameters["method"])
    assert find_integrator("projected[method=gauss2]").uses == (find_integrator("gauss2").plugin,)


@pytest.mark.parametrize("peer", ["solve_ivp_bdf", "scipy_odeint"])
def test_a_peer_keeps_the_laws_at_its_outputs_and_its_accuracy(peer):
    scenario = tcbench.scenarios()["bound_equilibrium"].replace(t_end=10.0)
    exact = reference_for(scenario, [10.0]).states[0]
    alone, run = (tcbench.simulate(name, scenario, tolerance=1e-6) for name in (peer, f"projected[method={peer}]"))
    assert np.abs(alone.energy - alone.energy[0]).max() > 1e-6 * scenario.initial_exergy
    assert np.abs(run.energy - run.energy[0]).max() < 1e-12 * scenario.initial_exergy
    assert np.abs(run.angular_momentum - run.angular_momentum[0]).max() < 1e-12
    assert np.diff(run.entropy).min() > -1e-13
    assert np.abs(run.z[-1] - exact).max() < 2 * np.abs(alone.z[-1] - exact).max()
    long = tcbench.simulate(f"projected[method={peer}]", "relative_equilibrium", tolerance=1e-5)  # nothing adds up
    assert np.abs(long.angular_momentum - long.angular_momentum[0]).max() < 1e-14 * 100 * 19.6
    assert "peer" in find_integrator(f"projected[method={peer}]").tags


def test_a_step_without_a_lawful_state_near_says_so():
    run = tcbench.simulate("projected[method=scipy_dopri5]", "viscous_pendulum", t_end=200.0, tolerance=0.9)
    assert run.status == "nonfinite" and "no finite state near the step's result has the energy" in run.failure


class Charge(tcbench.System):
    """In a field that grows outwards: its canonical momentum is of degree four, and no method of the paper keeps it."""

    variables = {"x": (2,), "p": (2,)}

    def energy(self, z):
        return z.p @ z.p / 2 + (z.x @ z.x) ** 2 / 4

    def entropy(self, z):
        return 0.0

    def reversible(self, z, dE, dS):
        return {"x": dE.p, "p": -dE.x + (1 + z.x @ z.x) * np.stack([dE.p[1], -dE.p[0]])}

    def invariants(self, z):
        r = z.x @ z.x
        return {"canonical": z.x[0] * z.p[1] - z.x[1] * z.p[0] + r / 2 + r**2 / 4}


def test_a_method_of_the_paper_keeps_by_its_projection_what_it_loses_alone():
    start = {"x": [0.5, 0.2], "p": [0.3, 0.8]}
    charge = tcbench.Scenario("charge", Charge, {}, initial=start, t_end=5, dt=0.2)
    alone, projected_ = (tcbench.simulate(m, charge) for m in ("tc_monolithic", "projected[method=tc_monolithic]"))
    lost = [run.summary.invariant_error_max["canonical"] for run in (alone, projected_)]
    assert projected_.ok and lost[1] < 1e-13 < 1e-4 < lost[0]
    assert projected_.summary.energy_error_max < 1e-13
