"""The function whose root is z1 in all its forms: order, sign, scale and mixture of rows do not matter."""

import numpy as np
import pytest

import tcbench
from tcbench import Flow, Integrator
from tcbench.compiler.array_states import is_array
from tcbench.plugins import find_integrator, find_scenario
from tcbench.simulation.run import simulate


def field(z0, z1, system):
    return system.vector_field((z0 + z1) / 2)


def plain(z0, z1, h, system):
    return z1 - z0 - h * field(z0, z1, system)


def backwards(rows):
    """The last first; of arrays, whose entries have no order, the last array."""
    return np.concatenate([rows.s, rows.p, rows.q]) if is_array(rows) else np.asarray(rows)[::-1]


FORMS = {
    "start first": lambda z0, z1, h, system: z0 + h * field(z0, z1, system) - z1,
    "step first": lambda z0, z1, h, system: h * field(z0, z1, system) - (z1 - z0),
    "end against start": lambda z0, z1, h, system: z1 - (z0 + h * field(z0, z1, system)),
    "negative": lambda *step: -plain(*step),
    "scaled": lambda *step: -4e9 * plain(*step),
    "tiny": lambda *step: 1e-12 * plain(*step),
    "rates": lambda z0, z1, h, system: (z1 - z0) / h - field(z0, z1, system),
    "negative rates": lambda z0, z1, h, system: field(z0, z1, system) - (z1 - z0) / h,
    "over h": lambda z0, z1, h, system: plain(z0, z1, h, system) / h,
    "times h": lambda z0, z1, h, system: -h * plain(z0, z1, h, system),
    "reversed": lambda *step: backwards(plain(*step)),
    "one row down": lambda *step: np.roll(np.asarray(plain(*step)), 1),
    "signs by turns": lambda *step: np.asarray(plain(*step)) * np.where(np.arange(len(step[0])) % 2, 1.0, -2.0),
    "energies": lambda z0, z1, h, system: np.concatenate([
        plain(z0, z1, h, system).q, plain(z0, z1, h, system).p, plain(z0, z1, h, system).s * -system.temperatures(z0)
    ]),
}  # fmt: skip


def run(formula, scenario, dt, t_end):
    return simulate(Integrator(name="form", order=2, flows=formula, source="x"), scenario, dt=dt, t_end=t_end)


FEW = ("start first", "scaled", "rates", "reversed")


@pytest.mark.parametrize(
    ("scenario", "dt", "t_end", "forms"),
    [("short_term", 0.1, 2.0, FORMS), ("stiff_spring", 1.0, 3.0, FEW), ("chain[n=12]", 0.1, 0.5, FEW)],
)  # fmt: skip
def test_every_form_of_a_formula_takes_the_same_steps(scenario, dt, t_end, forms):
    scenario = find_scenario(scenario)
    known = run(plain, scenario, dt, t_end)
    for name in forms:
        found = run(FORMS[name], scenario, dt, t_end)
        assert (found.status, found.steps) == (known.status, known.steps), name
        assert np.abs(found.z - known.z).max() < 1e-12 * np.abs(known.z).max(), name
        assert np.array_equal(found.z, known.z), name
        assert found.solver.newton_iterations == known.solver.newton_iterations, name


@pytest.mark.parametrize(
    ("name", "scenario"), [("midpoint_temperature", "short_term"), ("tc_gonzalez", "gas_containers")]
)
def test_a_sign_changes_no_bit_of_the_built_in_formulas(name, scenario):
    method = find_integrator(name)
    formula, variables = method.flows[0].residual, method.flows[0].variables
    flipped = Integrator(name="flipped", order=2, flows=lambda *step: -formula(*step), variables=variables)
    known, found = (simulate(m, scenario, dt=0.1, t_end=2.0) for m in (method, flipped))
    assert known.ok and np.array_equal(found.z, known.z) and found.solver == known.solver


def test_blocks_of_stages_may_come_in_any_order():
    gauss = find_integrator("gauss2").flows[0].residual
    known = simulate("gauss2", "short_term", dt=0.1, t_end=2.0)
    for order, signs in (((2, 0, 1), (1, -1, 1)),):

        def formula(*step, order=order, signs=signs):
            blocks = np.split(np.asarray(gauss(*step)), 3)
            return np.concatenate([sign * blocks[i] for i, sign in zip(order, signs, strict=True)])

        found = simulate(Integrator(name="g", order=4, flows=Flow(formula, stages=2)), "short_term", dt=0.1, t_end=2.0)
        assert np.array_equal(found.z, known.z)


@pytest.mark.parametrize("seed", range(1))
def test_mixtures_of_rows_are_taken_apart(seed):
    scenario = tcbench.scenarios()["short_term"]
    mixture = np.random.default_rng(seed).normal(size=(10, 10))
    known = run(plain, scenario, 0.1, 2.0)
    found = run(lambda *step: mixture @ np.asarray(plain(*step)), scenario, 0.1, 2.0)
    assert found.ok and np.abs(found.z - known.z).max() < 1e-12
    assert found.solver.retried == found.solver.tracked == found.solver.arcs == 0
