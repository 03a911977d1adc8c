"""A short run of the pendulum from a random state: its laws, to the round-off of what they are made of."""

import numpy as np
from hypothesis import reject

import tcbench


def assert_laws(method, state, conductivity, tolerance):
    scenario = tcbench.scenarios()["short_term"].replace(
        positions=state[:4], momenta=state[4:8], temperatures=state[8:], conductivity=conductivity, t_end=0.5, dt=0.1
    )
    run = tcbench.simulate(method, scenario, tolerance=tolerance)
    if "too short" in run.failure:  # two springs that collapse head-on: the solution itself ends
        reject()
    assert run.ok, run.failure
    heat = 5.0 * sum(scenario.temperatures)  # round-off of the energy is that of c0 theta
    assert np.abs(run.energy - run.energy[0]).max() <= 1e-12 * scenario.initial_exergy + 8e-15 * heat
    assert np.diff(run.entropy).min() >= -1e-13 * max(1.0, abs(run.entropy).max())
    scale = np.linalg.norm(scenario.positions) * np.linalg.norm(scenario.momenta)
    assert np.abs(run.angular_momentum - run.angular_momentum[0]).max() <= 1e-12 * (1.0 + scale)
