"""`march=`: a method's own loop over many steps gives what its steps give, and fails where they fail."""

import numpy as np
import pytest

import tcbench
from tcbench import Integrator, TcbenchError


def euler(z, h, system):
    return z + h * system.vector_field(z)


def in_one_go(z, h, count, system):
    states = []
    for _ in range(count):
        z = euler(system.state(np.array(z)), h, system)
        states.append(np.array(z))
    return states


def test_a_method_that_marches_gives_the_rows_that_its_steps_give():
    runs = [
        tcbench.simulate(
            Integrator(name="e", order=1, step=euler, march=march), "bound_equilibrium", dt=0.001, t_end=0.6
        )
        for march in (None, in_one_go)
    ]
    assert runs[0].steps == runs[1].steps == 600  # asked for in more than one piece
    np.testing.assert_array_equal(runs[0].z, runs[1].z)
    assert runs[0].summary == runs[1].summary


def test_a_march_that_ends_early_is_asked_again_and_a_blowup_within_it_is_found():
    def up_to_seven(z, h, count, system):
        return in_one_go(z, h, min(count, 7), system)

    START = tcbench.scenarios()["bound_equilibrium"].z0

    def explodes_after_eleven(z, h, count, system):
        states = np.repeat(np.array(z)[None], count, axis=0)
        states[10:, 4] += 100.0
        return states

    def fails_after_eleven(z, h, count, system):
        if np.array_equal(z, START):  # the first step is asked for by itself
            return in_one_go(z, h, count, system)
        if not np.array_equal(z, euler(START, h, system)):
            raise ArithmeticError("no root")
        return in_one_go(z, h, 20, system)[:10]

    def run(march):
        method = Integrator(name="e", order=1, step=euler, march=march)
        return tcbench.simulate(method, "bound_equilibrium", dt=0.001, t_end=0.1)

    assert run(up_to_seven).steps == 100 and run(up_to_seven).ok
    found = run(explodes_after_eleven)
    assert found.status == "blowup" and "step 12 " in found.failure and len(found.t) == 13
    found = run(fails_after_eleven)
    assert found.status == "nonconverged" and "step 12 " in found.failure and found.steps == 11
    assert "up to 1 states of 10 were asked for" in run(lambda z, h, count, system: np.zeros((count, 5))).failure
    assert run(lambda z, h, count, system: np.zeros((0, 10))).status == "exception"


def test_a_march_needs_a_step():
    with pytest.raises(TcbenchError, match="without step="):
        Integrator(name="e", order=1, flows=lambda z0, z1, h, s: z1 - z0, march=in_one_go)
