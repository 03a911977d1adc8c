"""States beside the laws are moved onto them: any system, by the kernels that a compiled march calls."""

import numpy as np
import pytest

import tcbench
from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import kernel
from tcbench.solver.mending import mended, mending_kernels

NAMES = ("damped_oscillator", "viscous_pendulum", "rubbing_piston", "rigid_body", "heavy_top", "reaction", "short_term")


def prepared(model):
    """(start, mend, hold, given)."""
    with trace.tracing():
        start, mend, hold, constants = mending_kernels(model.symbolic)
        setup = kernel(model.constant_symbols(), constants)
    c = model.constant_values
    return start, mend.address, hold.address, np.concatenate([c, setup(c, c)])


@pytest.mark.parametrize("name", NAMES)
def test_a_state_is_moved_onto_the_laws(name):
    """Energy and invariants are those of the start, the entropy no less, and the move is as long as the miss."""
    scenario = tcbench.scenarios()[name]
    model, z0, rng = scenario.model, scenario.z0, np.random.default_rng(0)
    start, mend, hold, given = prepared(model)
    found = np.empty(model.size + 2)
    for _ in range(20):
        target = start(z0, given)
        off = 1e-4 * rng.normal(size=model.size) * (1 + abs(z0))
        target[: model.size] += off
        assert mended(mend, hold, target, given, found)
        z = target[: model.size]
        assert model.energy(z) == pytest.approx(model.energy(z0), rel=1e-14, abs=1e-14)
        assert np.asarray(model.momenta(z)) == pytest.approx(np.asarray(model.momenta(z0)), rel=1e-14)
        assert model.entropy(z) >= model.entropy(z0) - 1e-14
        assert np.linalg.norm((z - z0 - off) / (1 + abs(z0))) <= 3 * np.linalg.norm(off / (1 + abs(z0)))


def test_what_no_state_has_is_not_reached():
    """An energy below the least of the system: False, and no endless search."""
    model = tcbench.scenarios()["rigid_body"].model
    start, mend, hold, given = prepared(model)
    target = start(np.array([0.6, 0.9, 0.5]), given)
    target[3] = -1.0
    assert not mended(mend, hold, target, given, np.empty(5))
    target[:3], target[3] = np.nan, 1.0
    assert not mended(mend, hold, target, given, np.empty(5))


def test_an_entropy_that_begins_at_0_may_miss_the_round_off_of_what_it_becomes():
    model = tcbench.scenarios()["damped_oscillator"].model
    start, mend, hold, given = prepared(model)
    target = start(np.array([2.0, 0.0, 0.0]), given)
    there = np.array([1.0, 1.0, 300.0])
    target[:5] = [*there, model.energy(there), 300.0 + 1e-10]
    assert mended(mend, hold, target, given, np.empty(5)) and abs(target[2] - 300.0) < 2e-10


class Twice(tcbench.System):
    """A rotator one of whose invariants is told twice: each of them alone says all that both do."""

    name = "twice"
    variables = {"m": (3,)}

    def energy(self, z):
        return (z.m * z.m / np.array([1.0, 2.0, 3.5])).sum() / 2

    def entropy(self, z):
        return 0.0 * z.m[0]

    def reversible(self, z, dE, dS):
        return {"m": np.cross(z.m, dE.m)}

    def invariants(self, z):
        return {"length": z.m @ z.m, "again": 3.0 * (z.m @ z.m)}


def test_an_invariant_that_says_nothing_new_moves_nothing():
    model, z0 = Twice(), np.array([0.6, 0.9, 0.5])
    start, mend, hold, given = prepared(model)
    target = start(z0, given)
    target[:3] += 1e-6
    assert mended(mend, hold, target, given, np.empty(5)) and np.linalg.norm(target[:3] - z0) < 1e-5
