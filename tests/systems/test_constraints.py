"""Holonomic constraints: laws, the constraints, order, the ODE under them, the start, and what is refused."""

import numpy as np
import pytest
from mechanics import Mechanical, OfEntropies
from tcbench_plugins.rods.rods import Hanging

import tcbench
from tcbench import Scenario, TcbenchError, plugins
from tcbench.simulation.metrics import conservation
from tcbench.systems.multipliers import Multipliers

SCENARIOS = [
    "rods[n=1]",
    "rods",
    "rod_loop",
    "four_masses",
    "director_body",
    "rods[n=100]",
    pytest.param("director_rod", marks=pytest.mark.thorough),
]


def scenario(name, **changes):
    return plugins.find_scenario(name).replace(**changes)


def missed(run):
    return np.abs(run.scenario.model.constraint_values(run.z)).max()


@pytest.mark.parametrize("name", SCENARIOS)  # det J of E + lam . g has the sign (-1)^m: see systems/constrained.py
def test_laws_momenta_and_constraints(name):
    run = tcbench.simulate("tc_monolithic", scenario(name, t_end=0.4))
    assert run.ok and run.summary.entropy_increment_min > -1e-15 and missed(run) < 1e-13
    assert run.summary.energy_error_max < 1e-13 and max(map(np.ptp, run.invariants.values())) < 1e-12


@pytest.mark.parametrize(
    ("method", "name"), [("tc_strang", "rods"), ("tc_staggered", "four_masses"), ("tc_gonzalez", "rods[n=100]"),
                         ("midpoint_entropy", "rods"), ("tc_gonzalez", "four_masses")]
)  # fmt: skip
def test_every_one_step_method(method, name):
    run = tcbench.simulate(method, scenario(name, t_end=0.4))
    assert run.ok and run.summary.entropy_increment_min > -1e-14 and missed(run) < 1e-13
    assert max(map(np.ptp, run.invariants.values())) < 1e-12
    assert method == "midpoint_entropy" or run.summary.energy_error_max < 1e-13


@pytest.mark.parametrize("name", ["rods", "four_masses"])
def test_the_projection_leaves_constraints_as_they_are(name):
    """Of the midpoint rule, which keeps them and loses the energy."""
    one = scenario(name, t_end=1.0)
    run = tcbench.simulate("projected[method=midpoint_entropy]", one)
    assert run.ok and missed(run) < 1e-14 and run.summary.entropy_increment_min > -1e-14
    assert run.summary.energy_error_max < 1e-13 and max(map(np.ptp, run.invariants.values())) < 1e-12


def test_large_steps():
    for h in (0.1, 0.2, 0.4):
        run = tcbench.simulate("tc_monolithic", scenario("rods", t_end=0.8), dt=h)
        assert run.ok and missed(run) < 1e-14 and run.summary.energy_error_max < 1e-13


def test_steps_of_many_times_the_explicit_limit():
    """On the imaginary axis peers of order 4 are stable up to 2.8 / |lambda| of the ODE under the constraints."""
    one = scenario("director_rod[n=3]")
    rate, z = Multipliers(one.model).rate, np.array(one.z0)
    slopes = np.array([rate(z + 1e-6 * e) - rate(z - 1e-6 * e) for e in np.eye(len(z))]).T / 2e-6
    limit = 2.8 / np.abs(np.linalg.eigvals(slopes)).max()
    for times in (20, 50):
        run = tcbench.simulate("tc_monolithic", one, dt=times * limit, t_end=30 * times * limit)
        assert run.ok and missed(run) < 1e-14 and run.summary.energy_error_max < 1e-13
        assert run.summary.entropy_increment_min > 0


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["rods", "rods[n=10]"])
def test_ten_thousand_steps_of_rods(name):
    one = scenario(name)
    run = tcbench.simulate("tc_monolithic", one, t_end=10_000 * one.dt, record_every=50)
    assert run.ok and run.steps == 10_000 and missed(run) < 1e-14 and run.summary.energy_error_max < 1e-13
    assert run.summary.entropy_increment_min > -1e-15 and max(map(np.ptp, run.invariants.values())) < 1e-12


def test_a_liquid_core_turns_a_body_to_its_axis_of_largest_inertia():
    run = tcbench.simulate("tc_monolithic", "director_body", t_end=3000.0, dt=0.5, record_every=100)
    end = run.scenario.model.state(run.z[-1])
    largest = np.reshape(end.d, (3, 3))[0]  # Euler's inertia 0.1 along it, and so 0.2 + 0.3 about it
    spin = np.array([run.invariants[f"angular_momentum_{x}"][0] for x in "xyz"])
    assert run.ok and abs(largest @ spin) > 0.999 * np.linalg.norm(spin) and missed(run) < 1e-12
    assert run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-14


@pytest.mark.parametrize(
    ("method", "name"),
    [("tc_monolithic", "rods"), ("tc_staggered", "rods"),
     pytest.param("tc_strang", "director_body", marks=pytest.mark.thorough)],
)  # fmt: skip
def test_order_against_the_reference(name, method):
    from tcbench.reference.lookup import reference_for

    one = scenario(name, t_end=0.4)
    exact = reference_for(one, [0.4])
    assert exact.floor[0] < 1e-13
    order = plugins.find_integrator(method).order
    steps = [0.005, 0.0025] if order == 2 else [0.001, 0.0005]
    errors = [np.abs(tcbench.simulate(method, one, dt=h).z[-1] - exact.states[0]).max() for h in steps]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.06


@pytest.mark.parametrize(
    ("k", "name", "t_end", "steps"),
    [(1, "rods", 0.4, 20), (2, "rods", 0.4, 20), (3, "rods[n=1]", 0.4, 5),
     pytest.param(3, "director_body", 0.4, 5, marks=pytest.mark.thorough)],
)  # fmt: skip
def test_collocation_has_its_order_and_keeps_laws_constraints_and_their_rates(k, name, t_end, steps):
    from tcbench.reference.lookup import reference_for

    one = scenario(name, t_end=t_end)
    exact = reference_for(one, [t_end]).states[0]
    runs = [tcbench.simulate(f"tc_gauss[k={k}]", one, dt=t_end / n) for n in (steps, 2 * steps)]
    errors = [np.abs(run.z[-1] - exact).max() for run in runs]
    assert abs(np.log2(errors[0] / errors[1]) - 2 * k) < 0.15
    assert missed(runs[0]) < 1e-14 and np.abs(one.model.constraint_speeds(runs[0].z)).max() < 1e-13
    assert runs[0].summary.energy_error_max < 1e-14 and runs[0].summary.entropy_increment_min > -1e-14
    assert max(map(np.ptp, runs[0].invariants.values())) < 1e-13


def test_numbers_take_the_place_of_formulas_in_the_ode_of_large_systems(monkeypatch):
    small = scenario("rods[n=10]")
    by_numbers = Multipliers(small.model).rate(small.z0)
    assert np.allclose(by_numbers, small.model.vector_field(small.z0), rtol=1e-13, atol=1e-13)
    monkeypatch.setattr("tcbench.systems.constrained.MOST_REDUCED", 80)
    run = tcbench.simulate("scipy_dop853", "rods[n=12]", t_end=0.02, tolerance=1e-8)
    assert run.ok and missed(run) < 1e-10
    with pytest.raises(TcbenchError, match="scipy_dop853"):
        tcbench.simulate("solve_ivp_radau", "rods[n=12]", t_end=0.02, tolerance=1e-8)


def test_multipliers_are_the_forces_that_hold_the_rods():
    """Of a pendulum at rest, straight down, lam times the length is the weight."""
    one = scenario("rods[n=1]", q=[[0, 0, -1.0]], p=[[0, 0, 0.0]], t_end=0.1)
    run = tcbench.simulate("tc_monolithic", one)
    assert np.allclose(run.multipliers["lam"], 9.81)
    row = conservation(run)
    assert row["lam_max"] == pytest.approx(9.81) and row["lam_constraint_max"] < 1e-15
    assert row["lam_constraint_speed_max"] < 1e-15


def test_the_hidden_constraint_is_of_second_order():
    runs = [tcbench.simulate("tc_monolithic", scenario("rods", t_end=0.4), dt=h) for h in (0.01, 0.005)]
    speeds = [conservation(run)["lam_constraint_speed_max"] for run in runs]
    assert 1.8 < np.log2(speeds[0] / speeds[1]) < 2.2


def test_starts_off_the_constraints_are_refused_with_the_nearest_that_is_not():
    q = np.array(scenario("rods").initial["q"])
    for wrong, told in (({"q": 1.01 * q}, "constraints"), ({"p": [[1.0, 0, 0], [0, 0, 0], [0, 0, 0]]}, "the rate of")):
        one = scenario("rods", t_end=0.1, **wrong)
        with pytest.raises(TcbenchError, match=rf"at the start {told}.*nearest start that is consistent"):
            tcbench.simulate("tc_monolithic", one)
        assert tcbench.simulate("tc_monolithic", one.consistent()).ok
    with pytest.raises(TcbenchError, match="contradict each other"):
        tcbench.simulate("tc_monolithic", scenario("four_masses", length=[1, 1, 1, 1, 1, 50.0]))


def test_redundant_constraints_are_named():
    body = scenario("four_masses")
    ends, length = body.constants["ends"], body.constants["length"]
    with pytest.raises(TcbenchError, match=r"of its 7 constraints 6 are independent.*number 7 of 7 of lam"):
        tcbench.simulate("tc_monolithic", body.replace(ends=[*ends, ends[0]], length=[*length, length[0]]))


class FourBar(Mechanical):
    """Two masses, hung on pivots at 0 and at 2, and joined."""

    name = "four_bar"
    variables = {"q": (2, 2), "p": (2, 2), "s": ()}
    constants = {"rocker": ()}
    multipliers = {"crank": (), "coupler": (), "arm": ()}

    def energy(self, z):
        return (z.p**2).sum() / 2 + z.q[:, 1].sum() + np.exp(z.s)

    def constraints(self, z):
        x, y = z.q
        far = np.stack([y[0] - 2.0, y[1]])
        return {"crank": x @ x - 1, "coupler": (y - x) @ (y - x) - 4, "arm": far @ far - self.rocker**2}

    def irreversible(self, z, dE, dS):
        return {"p": -0.05 * dE.p, "s": 0.05 * (dE.p**2).sum() / dE.s}


def four_bar(angle, rocker=1.0):
    x = np.array([np.cos(angle), np.sin(angle)])
    start = {"q": [x, x + np.array([2.0, 0.0])], "p": np.zeros((2, 2)), "s": 0.0}
    one = Scenario("bar", FourBar, {"rocker": rocker}, initial=start, t_end=4.0, dt=0.02, shows="", source="")
    return one if rocker == 1 else one.consistent()


def test_a_linkage_that_lies_flat_is_told_at_the_start_and_where_a_run_passes_it():
    """Both go on with all laws, as a parallelogram or crossed: which, no equation says."""
    with pytest.raises(TcbenchError, match="coupler says nothing that crank and arm do not"):
        tcbench.simulate("tc_monolithic", four_bar(0.0))
    for method in ("tc_monolithic", "tc_auto"):
        run = tcbench.simulate(method, four_bar(1.0))
        assert run.ok and missed(run) < 1e-13
        assert "the constraints crank, coupler and arm come to depend on each other" in run.constraints_dependent
        assert conservation(run)["constraints_dependent"].startswith("near t = 1.7")
    near = tcbench.simulate("tc_monolithic", four_bar(1.0, 1.05))  # never flat
    assert near.ok and not near.constraints_dependent and "constraints_dependent" not in conservation(near)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_unusual_units(unit):
    """Lengths in other units, energies with them: the run is the same."""
    plain = scenario("rods", t_end=0.4)
    other = plain.replace(
        q=unit * np.array(plain.initial["q"]), p=unit * np.array(plain.initial["p"]),
        s=unit**2 * np.array(plain.initial["s"]), length=unit * np.ones(3), gravity=[0, 0, -9.81 * unit],
        heat_capacity=2.0 * unit**2, lowest=unit**2 * plain.constants["lowest"],
        friction=0.1 / unit**2, conductivity=0.3 * unit**2,
    )  # fmt: skip
    one, two = (tcbench.simulate("tc_monolithic", x) for x in (plain, other))
    assert two.ok and np.allclose(one.z[-1][:9], two.z[-1][:9] / unit, atol=1e-9)
    assert missed(two) < 1e-13 * unit**2 and two.summary.energy_error_max < 1e-12


@pytest.mark.parametrize(
    ("method", "name"),
    [("tc_auto", "rods[n=1]"), ("tc_taylor", "rods[n=1]"), ("tc_gauss_adaptive", "rods[n=1]"), ("tc_auto", "rods"),
     *(pytest.param(method, name, marks=pytest.mark.thorough) for method, name in (
         ("tc_auto", "director_body"), ("tc_auto", "four_masses"), ("tc_auto", "rods[n=10]"),
         ("tc_gauss_adaptive", "director_body"), ("tc_taylor", "rod_loop[n=5]")))],
)  # fmt: skip
def test_adaptive_methods_meet_the_tolerance_and_keep_laws_and_constraints(method, name):
    from tcbench.reference.lookup import reference_for

    one = scenario(name, t_end=0.5)
    exact = reference_for(one, [0.5]).states[0]
    for tolerance in (1e-3, 1e-6):
        run = tcbench.simulate(method, one, tolerance=tolerance)
        assert run.ok and np.abs(run.z[-1] - exact).max() < tolerance and missed(run) < 1e-14
        assert np.abs(one.model.constraint_speeds(run.z)).max() < 1e-13
        assert run.summary.energy_error_max < 1e-13 and run.summary.entropy_increment_min > -1e-14
        assert max(map(np.ptp, run.invariants.values())) < 1e-12


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_an_adaptive_method_meets_the_tolerance_of_stiff_joints(tolerance):
    from tcbench.reference.lookup import reference_for

    one = scenario("rods", t_end=0.5, friction=100.0, conductivity=300.0)
    run = tcbench.simulate("tc_auto", one, tolerance=tolerance)
    assert run.ok and np.abs(run.z[-1] - reference_for(one, [0.5]).states[0]).max() < tolerance
    assert missed(run) < 1e-14 and run.summary.energy_error_max < 1e-13


def test_methods_that_cannot_are_refused():
    for name in ("gauss2", "bdf2", "cpg_invariant", "projected[method=gauss2]"):
        with pytest.raises(TcbenchError, match=r"has constraints.*tc_invariant, which keeps every invariant"):
            tcbench.simulate(name, scenario("rods"))
    with pytest.raises(TcbenchError, match=r"up to 100 numbers; .* take tc_monolithic"):
        tcbench.simulate("tc_auto", "director_rod", tolerance=1e-3)


class Bead(Mechanical):
    name = "bead"
    variables = {"q": (2,), "p": (2,), "s": ()}

    def energy(self, z):
        return z.p @ z.p / 2 + z.q[1] + np.exp(z.s)

    def irreversible(self, z, dE, dS):
        return {"p": -0.1 * dE.p, "s": 0.1 * dE.p @ dE.p / dE.s}


@pytest.mark.parametrize(
    ("g", "told"),
    [(lambda z: z.q @ z.q - (1 + 0.1 * z.s) ** 2, "reads s, which moves with the constraint's own force"),
     (lambda z: z.p[0] - z.q[1] - 1.6, "reads p, which moves with the constraint's own force"),
     (lambda z: 0 * z.q[0], "no force holds lam"), (lambda z: (z.q @ z.q - 1) ** 2, "no force holds lam"),
     (lambda z: z.q, r"declared to hold one number; it is given shape \(2,\)"), (lambda z: None, "it is given nothing"),
     (lambda z: np.sqrt(z.q[1]) - 1, "no state near it that satisfies them")],
)  # fmt: skip
def test_what_cannot_be_held_is_told_in_a_sentence_to_every_method(g, told):
    system = type("OneBead", (Bead,), {"multipliers": {"lam": ()}, "constraints": lambda self, z: {"lam": g(z)}})
    start = {"q": [0.6, -0.8], "p": [0.8, 0.6], "s": 0.0}
    one = tcbench.Scenario("bead", system, {}, initial=start, t_end=0.1, dt=0.02, shows="", source="")
    for method in ("tc_monolithic", "tc_gauss", "scipy_dop853"):
        with np.errstate(all="ignore"), pytest.raises(TcbenchError, match=told):
            tcbench.simulate(method, one)


def test_multipliers_and_constraints_go_together():
    with pytest.raises(TcbenchError, match="go together"):
        type("Half", (Hanging,), {"multipliers": {}})


def test_errors_of_the_energy_are_measured_by_what_moves_under_the_constraints():
    """They were by what falls without them: 200 for 0.2, so that errors looked 400 times smaller."""

    class Bead(OfEntropies):
        name = "bead_on_a_sphere"
        variables = {"x": (3,), "p": (3,), "s": (2,)}
        constants = {}
        multipliers = {"lam": ()}

        def energy(self, z):
            return z.p @ z.p / 2 + z.x[2] + np.exp(z.s).sum()

        def reversible(self, z, dE, dS):
            return {"x": dE.p, "p": -dE.x}

        def irreversible(self, z, dE, dS):
            flow = 0.1 * (dE.s[1] - dE.s[0])
            return {"s": np.stack([flow / dE.s[0], -flow / dE.s[1]])}

        def constraints(self, z):
            return {"lam": (z.x @ z.x - 1) / 2}

    start = {"x": [0.6, 0.0, -0.8], "p": [0.0, 0.7, 0.0], "s": [0.0, 0.5]}
    assert 0.1 < Scenario("bead", Bead, {}, initial=start, t_end=20.0, dt=0.05).initial_exergy < 0.6
