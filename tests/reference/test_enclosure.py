"""Proven bounds: balls that contain the exact state, by a way of their own."""

import numpy as np
import pytest

import tcbench
from tcbench import TcbenchError
from tcbench.reference import certified

pytest.importorskip("flint")
from flint import arb, ctx

from benchmarks.proven_reference import box_of, evaluated, exact, proven_state


@pytest.fixture(autouse=True)
def precision():
    before = ctx.prec
    ctx.prec = 300
    yield
    ctx.prec = before


def radius(state):
    return max(float(x.rad()) for x in state)


def test_it_holds_the_exponential_and_the_state_of_other_solvers():
    scenario = tcbench.scenarios()["bound_equilibrium"]
    state = proven_state(scenario, 0.0625, steps=4, order=20, bits=200)
    other = tcbench.simulate("tc_taylor", scenario, t_end=0.0625, tolerance=1e-15).z[-1]
    assert 0 < radius(state) < 1e-12  # a ball of no radius would prove nothing
    assert max(abs(float(x.mid()) - y) for x, y in zip(state, other, strict=True)) < 1e-12
    wider = proven_state(scenario, 0.0625, steps=4, order=6, bits=200)
    assert all(w.contains(x) for w, x in zip(wider, state, strict=True)) and radius(wider) > 1e3 * radius(state)


def test_the_energy_of_the_end_holds_that_of_the_start():
    model = (scenario := tcbench.scenarios()["bound_equilibrium"]).model
    constants = [exact(x) for x in model.constant_values]
    start = [exact(x) for x in (*scenario.positions, *scenario.momenta, *scenario.temperatures)]
    z0 = evaluated(model.formula("entropy_variables")[0], start, constants)
    z1 = proven_state(scenario, 0.0625, steps=4, order=16, bits=200)
    before, after = (evaluated(model.formula("energy")[0], z, constants)[0] for z in (z0, z1))
    assert after.contains(before) and float(after.rad()) < 1e-9
    moved = [z1[0] + arb("1e-6"), *z1[1:]]
    assert not evaluated(model.formula("energy")[0], moved, constants)[0].overlaps(before)


def test_data_are_the_decimals_that_were_written():
    assert exact(2.2).contains(arb(22) / 10) and not arb(2.2).contains(arb(22) / 10)
    assert float(exact(0.5).rad()) == 0


def test_no_box_is_an_error_that_says_what_to_do():
    scenario = tcbench.scenarios()["short_term"]
    with pytest.raises(TcbenchError, match="take more steps"):
        proven_state(scenario, 1.0, steps=4, order=8, bits=200)


def test_a_box_holds_what_leaves_it_nowhere():
    text = "def kernel(a, b, out):\n    out[0] = -a[0]\n"
    (box,) = box_of(text, [arb(1)], arb("0.125"), [])
    assert all(box.contains(arb(float(np.exp(-0.125 * share)))) for share in (0, 0.5, 1))


@pytest.mark.slow
def test_stored_states_at_t_1_are_proven():
    """bound_equilibrium in 10 s; short_term, where conduction is stiff, in minutes."""
    for name, settings, proven in (("bound_equilibrium", (64, 24, 300), 1e-16), ("short_term", (1024, 60, 900), 1e-17)):
        scenario, reference = tcbench.scenarios()[name], certified.stored(name)
        state = proven_state(scenario, 1.0, *settings)
        ctx.prec = 400
        stored = [arb(text) for text in reference.exact[reference.index(1.0)]]
        assert radius(state) < proven
        digits = arb("1e-27")  # of what is stored: thirty
        assert all(abs(x - y) < x.rad() * 2 + digits * (1 + abs(y)) for x, y in zip(state, stored, strict=True))
