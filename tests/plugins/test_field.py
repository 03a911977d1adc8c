"""Methods of the field since 2009: orders, and what makes each of them what it is; tests/laws has their laws."""

import numpy as np
import pytest
from tcbench_plugins.hbvm import boundary_value
from tcbench_plugins.ybaby import modified_energy

import tcbench
from tcbench import Flow, Integrator, Scenario, System, TcbenchError
from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import kernel
from tcbench.plugins import find_integrator
from tcbench.runner.plan import plan_job

from ..helpers.networks import NETWORKS

SCENARIOS = tcbench.scenarios()
ASIDE = [name for name, method in tcbench.integrators().items() if not method.by_default and not method.lacks]
STEPPED = [name for name in ASIDE if find_integrator(name).kind != "adaptive"]
MEMBERS = [member.name for name in STEPPED for member in find_integrator(name).variants()]
STEPS = {2: 256, 3: 256, 4: 64, 6: 16}  # by order, to t = 1, and twice as many: asymptotic, and far from round-off


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.thorough] if "[" in name else []) for name in MEMBERS]
)
def test_order(name):
    """Errors are the largest of eight times."""
    method = find_integrator(name)
    for scenario in ("rubbing_piston", "gas_containers"):
        scenario = SCENARIOS[scenario].replace(t_end=1.0)
        if method.suits(scenario.model):
            continue
        exact = tcbench.simulate("gauss3", scenario, dt=1 / 256).z[::32]
        errors = [
            np.abs(tcbench.simulate(name, scenario, dt=1 / n).z[:: n // 8] - exact).max()
            for n in (STEPS[method.order], 2 * STEPS[method.order])
        ]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.1), scenario.name
        break


def test_they_run_where_they_are_named():
    cells = {cell.integrator for cell in plan_job(None, ["short_term"], ["conservation"]).cells}
    assert "tc_monolithic" in cells and not cells & set(ASIDE)
    cells = {cell.integrator for cell in plan_job(["*"], ["short_term"], ["conservation"]).cells}
    assert set(STEPPED) <= cells


# ---- Shang and Ottinger (2020): their equations once more, in plain numpy


def by_equations(system, modified, dt):
    """The states of YBABY or mYBABY, as printed for the damped pendulum and the gas containers."""
    friction, alpha = 0.01, 0.5

    def energies(q, s):
        return (np.exp(s) / np.array([q, 2 - q])) ** (2 / 3)

    def heat(q, p, s):
        E, (r, t) = energies(q, s), (q, 2 - q)
        force = E[0] / r - E[1] / t
        a, b = (
            (1 + dt**2 * (5 * p * p / x - 2 * sign * force) / (54 * x) if modified else 1.0)
            for x, sign in ((r, 1), (t, -1))
        )
        flow = 9 * alpha / 4 * (b / E[0] - a / E[1])
        return np.array([b / E[0] * flow, -a / E[1] * flow])

    def Y(q, p, s):
        if system == "gas_containers":
            return p, s + dt / 2 * heat(q, p, s + dt / 4 * heat(q, p, s))
        factor = 1 + dt**2 * np.cos(q) / 6 if modified else 1.0
        return p * np.exp(-friction * dt / 2 * factor), s + p * p / 2 * factor * -np.expm1(-friction * dt * factor)

    def force(q, s):
        return 2 / 3 * (energies(q, s) / [q, 2 - q]) @ [1, -1] if system == "gas_containers" else -np.sin(q)

    z0 = SCENARIOS[system].z0
    q, p, s = z0[0], z0[1], (z0[2:] if system == "gas_containers" else z0[2])
    while True:
        p, s = Y(q, p, s)
        p += dt / 2 * force(q, s)
        q += dt * p
        p += dt / 2 * force(q, s)
        p, s = Y(q, p, s)
        yield np.hstack([q, p, s])


@pytest.mark.parametrize("system", ["gas_containers", "damped_oscillator"])
@pytest.mark.parametrize("name", ["ybaby", "mybaby"])
def test_the_printed_equations_step_by_step(name, system):
    states = by_equations(system, name == "mybaby", 0.1)
    run = tcbench.simulate(name, system, dt=0.1, t_end=10.0)
    assert run.z[1:] == pytest.approx(np.array([next(states) for _ in range(100)]), rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("system", ["bound_equilibrium", "damped_oscillator"])
def test_verlet_keeps_the_modified_energy_to_order_four(system):
    """With nothing that dissipates; that of the unmodified is two."""
    still = {"conductivity": 0.0, "friction": 0.0, "viscosity": (1e12, 1e12)}
    scenario = SCENARIOS[system]
    scenario = scenario.replace(t_end=2.0, **{n: x for n, x in still.items() if n in scenario.constants})
    sym, z = scenario.model.symbolic, trace.variables("z", scenario.model.size)
    h = trace.variable("h")
    inputs = {s: f"a[{i}]" for i, s in enumerate([*z, h])} | scenario.model.constant_symbols()
    modified = kernel(inputs, [modified_energy(sym, sym.state(z), h), trace.lifted(sym.energy(z))])
    lost = []
    for steps in (200, 400):
        run = tcbench.simulate("ybaby", scenario, t_end=2.0, dt=2 / steps)
        seen = np.array([modified(np.array([*state, 2 / steps]), scenario.model.constant_values) for state in run.z])
        lost.append(np.abs(seen - seen[0]).max(axis=0))
    orders = np.log2(lost[0] / lost[1])
    assert orders == pytest.approx([4, 2], abs=0.2)


def test_linear_friction_keeps_the_conformal_symplectic_structure():
    """The area of (q, p) shrinks by exp(-friction h) in a step, exactly."""
    scenario, h, d = SCENARIOS["damped_oscillator"].replace(friction=0.3, s=0.0), 0.2, 1e-5

    def step(q, p):
        return tcbench.simulate("ybaby", scenario.replace(q=q, p=p), dt=h, t_end=h).z[-1][:2]

    slopes = [(step(1.2 + a, 0.7 + b) - step(1.2 - a, 0.7 - b)) / (2 * d) for a, b in ((d, 0), (0, d))]
    assert np.linalg.det(slopes) == pytest.approx(np.exp(-0.3 * h), rel=1e-9)


def test_systems_without_momenta_are_refused_in_a_sentence():
    for name in ("rigid_body", "heavy_top", "reaction"):
        with pytest.raises(TcbenchError, match=rf"mybaby.*positions q and momenta p .* which {name} has not"):
            tcbench.simulate("mybaby", name)
    with pytest.raises(TcbenchError, match=r"'ybaby'.*multipliers"):
        tcbench.simulate("ybaby", "rods[n=3]", dt=0.01)


# ---- a variational integrator of thermodynamics


def test_a_variational_step_solves_the_discrete_lagrange_dalembert_equations():
    """Of two ideal gases, with their free energies A = theta (3/2 - 3/2 ln(3 theta/2) - ln V), by central differences;
    thermal displacements a start from 0, and the momenta are those of both ends."""
    h, start = 0.1, SCENARIOS["gas_containers"].replace(temperatures=(1.2, 1.5))
    (q0, p0, *s0), (q1, p1, *s1) = tcbench.simulate("variational", start, dt=h, t_end=h).z
    middle = (q0 + q1) / 2, np.add(s0, s1) / 2

    def lagrangian(x):
        (q, r), theta = x[:2], x[2:] / h
        free = [theta * (1.5 - 1.5 * np.log(1.5 * theta) - np.log([q, 2 - q])) for q in (q, r)]
        return h * ((r - q) / h) ** 2 / 2 - h / 2 * np.sum(free)

    def temperatures(q, s):
        return (np.exp(s) / [q, 2 - q]) ** (2 / 3) / 1.5

    def conduction(theta):
        a, b = theta
        return 0.5 * np.array([(b - a) / (a * a * b), (a - b) / (a * b * b)])

    theta = temperatures(*middle)  # of Newton's first, which finds the one that both ends agree on
    at = np.array([q0, q1, *(h * theta)])
    for _ in range(50):
        slopes = np.array([lagrangian(at + e) - lagrangian(at - e) for e in 1e-6 * np.eye(4)]) / 2e-6
        produced = h * conduction(at[2:] / h)
        at[2:] *= 1 + (np.array(s0) + produced / 2 - slopes[2:]) / 3
    assert [-slopes[0], slopes[1]] == pytest.approx([p0, p1], rel=1e-8)  # no friction here
    assert [*(slopes[2:] - produced / 2), *(slopes[2:] + produced / 2)] == pytest.approx([*s0, *s1], rel=1e-7)
    assert np.abs(produced).min() > 1e-3


def test_a_variational_integrator_needs_entropies_as_variables_and_no_closed_form_of_temperatures():
    class ByEnergy(System):
        """Its entropy is a function of an energy u."""

        name = "by_energy"
        variables = {"q": (), "p": (), "u": ()}
        constants = {"rub": ()}

        def energy(self, z):
            return (z.q**2 + z.p**2) / 2 + z.u

        def entropy(self, z):
            return np.log(z.u)

        def reversible(self, z, dE, dS):
            return {"q": dE.p, "p": -dE.q}

        def irreversible(self, z, dE, dS):
            return {"p": -self.rub * dE.p, "u": self.rub * dE.p**2 / dE.u}

    scenario = Scenario("of_energy", ByEnergy, {"rub": 0.1}, initial={"q": 1, "p": 0, "u": 1}, t_end=1, dt=0.1)
    with pytest.raises(TcbenchError, match="entropies as variables, which by_energy has not"):
        tcbench.simulate("variational", scenario)


# ---- collocation beyond Gauss's


class Quartic(System):
    """A mass on a spring of the fourth power, without heat: H is a polynomial."""

    name = "quartic"
    variables = {"q": (), "p": ()}

    def energy(self, z):
        return z.p**2 / 2 + z.q**4 / 4

    def entropy(self, z):
        return 0 * z.q

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}


def test_hbvm_keeps_polynomial_energies_by_more_points_than_stages():
    quartic = Scenario("quartic", Quartic, {}, initial={"q": 1, "p": 0.5}, t_end=20.0, dt=0.5)
    lost = {}
    for k in (2, 3, 4):
        method = Integrator(name=f"hbvm{k}", order=4, flows=Flow(boundary_value(k, 2), stages=1))
        run = tcbench.simulate(method, quartic)
        lost[k] = np.abs(run.energy - run.energy[0]).max()
    assert lost[4] < 1e-14 and lost[3] > 1e-6  # degree four by two stages: 2k/s is four for k = 4
    gauss = tcbench.simulate("gauss2", quartic)
    assert lost[2] == pytest.approx(np.abs(gauss.energy - gauss.energy[0]).max(), rel=1e-9)


def test_projecting_all_coordinates_loses_angular_momentum():
    scenario = SCENARIOS["bound_equilibrium"].replace(t_end=30.0)
    lost = {m: tcbench.simulate(m, scenario, dt=0.3).summary.invariant_error_max for m in ("cpg[k=1]", "tc_gauss[k=1]")}
    assert lost["cpg[k=1]"]["angular_momentum"] > 1e-4 and lost["tc_gauss[k=1]"]["angular_momentum"] < 1e-13


def test_relaxation_keeps_its_order_where_every_length_gives_the_energy():
    """Of cells that react all energy is heat: the length was what round-off made of it, errors 100 times as large."""
    cells = NETWORKS["reactions"]
    best = tcbench.simulate("gauss2", cells, dt=0.0025, t_end=0.1).z[-1]
    runs = [tcbench.simulate("relaxation[order=2]", cells, dt=h, t_end=0.1) for h in (0.02, 0.01)]
    coarse, fine = (np.abs(run.z[-1] - best).max() for run in runs)
    assert fine < 1e-5 and 3.5 < coarse / fine < 4.5


def test_relaxation_ends_where_no_length_gives_the_energy():
    run = tcbench.simulate("relaxation", "short_term", dt=0.3)
    assert run.status == "nonfinite" and run.steps == 0


# ---- thermal variables


def test_an_energy_that_cannot_be_solved_for_the_entropy_is_refused():
    class Twice(type(SCENARIOS["gas_containers"].model)):
        name = "twice"

        def element_energy(self, pi, s):
            return super().element_energy(pi, s) + 0.01 * s * s

    gas = SCENARIOS["gas_containers"]
    twice = Scenario("twice", Twice, gas.constants, positions=(1,), momenta=(2,), temperatures=(1, 1), t_end=1, dt=0.1)
    with pytest.raises(TcbenchError, match="does not hold just once"):
        tcbench.simulate("tc_energy", twice)
    assert tcbench.simulate("tc_monolithic", twice).ok


@pytest.mark.parametrize("name", ["tc_temperature", "tc_energy"])
def test_networks_take_other_thermal_variables(name):
    """Traced on one element for all, as the whole."""
    from tcbench.plugins import find_scenario

    run = tcbench.simulate(name, find_scenario("chain[n=6]"), dt=0.1, t_end=5.0)
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-13
