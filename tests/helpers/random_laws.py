"""A short run from a random state, of the pendulum or of any system: its laws, to the round-off of what they are made
of."""

import numpy as np
from hypothesis import reject

import tcbench
from tcbench import TcbenchError


def on_a_line(state):
    """Whether masses, fixed end and momenta are on one line: nothing turns aside, and springs collapse to length 0."""
    first, *others = state[:8].reshape(4, 2)
    return all(abs(first[0] * y - first[1] * x) <= 1e-6 for x, y in others)


def assert_laws(method, state, conductivity, tolerance):
    t_end = 0.1 if on_a_line(state) else 0.5  # near length 0 the solution itself asks for 1e8 steps
    scenario = tcbench.scenarios()["short_term"].replace(
        positions=state[:4], momenta=state[4:8], temperatures=state[8:], conductivity=conductivity, t_end=t_end, dt=0.1
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


GENERAL = ("damped_oscillator", "viscous_pendulum", "rubbing_piston", "rigid_body", "heavy_top", "reaction")
QUICK = ("damped_oscillator", "rigid_body", "reaction")  # whose formulas are the shortest: what is compiled is few
DISSIPATION = ("friction", "damping", "conductivity", "speed")  # constants that it grows with, of all of these


def random_start(name, seed, times=1.0):
    """The scenario from a random state that is admissible, with so many times the dissipation."""
    scenario = tcbench.scenarios()[name]
    constants = {c: times * np.asarray(x) for c, x in scenario.constants.items() if c in DISSIPATION}
    if "viscosity" in scenario.constants:
        constants["viscosity"] = np.asarray(scenario.constants["viscosity"]) / times
    rng = np.random.default_rng(seed)
    while True:
        z = scenario.model.nearby(scenario.z0, rng)
        try:
            return scenario.replace(**constants, **scenario.model.initial_of(z))
        except TcbenchError:  # not admissible
            continue


def assert_laws_of_any(method, name, seed, tolerance, times=1.0, of_t_end=0.05):
    """A run from a random state of a general system, over a part of its time."""
    scenario = random_start(name, seed, times)
    scenario = scenario.replace(t_end=of_t_end * scenario.t_end)
    run, model = tcbench.simulate(method, scenario, tolerance=tolerance), scenario.model
    assert run.ok, run.failure
    made_of = 1.0 + abs(run.energy[0]) + (abs(np.asarray(model.gradient(run.z)) * run.z)).sum(axis=1).max()
    assert np.abs(run.energy - run.energy[0]).max() <= 1e-12 * made_of
    made_of = 1.0 + (abs(np.asarray(model.entropy_gradient(run.z)) * run.z)).sum(axis=1).max()
    assert np.diff(run.entropy).min() >= -1e-12 * made_of
    momenta = np.asarray(model.momenta(run.z))
    assert np.all(abs(momenta - momenta[0]) <= 1e-12 * (1.0 + abs(run.z).max() ** 2))
