"""Formulas are the same whenever they are called: noise would be frozen in a trace, and every run would be another."""

import itertools
import time

import numpy as np
import pytest

import tcbench
from tcbench import ElementSystem, Integrator, Scenario, System, TcbenchError

COUNT, RNG = itertools.count(1), np.random.default_rng(0)
NOISE = {
    "numpy": lambda: np.random.standard_normal(),  # noqa: NPY002
    "a generator": lambda: RNG.random(),
    "a clock": lambda: time.perf_counter(),
    "a counter": lambda: next(COUNT),
}


def noisy(kick, where):
    """An oscillator with something that changes in one of its formulas (Langevin's equation, as
    https://github.com/SciML/DifferentialEquations.jl/issues/857 asks for it)."""

    def rub(self, z, dE, dS):
        force = 0.1 * dE.p + (kick() if where == "irreversible" else 0.0)
        return {"p": -force, "s": force * dE.p / dE.s}

    def energy(self, z):
        return z.p**2 / 2 + z.q**2 / 2 + z.s + (kick() * z.q if where == "energy" else 0.0)

    kind = type("Noisy", (System,), {
        "name": "noisy", "variables": {"q": (), "p": (), "s": ()}, "constants": {}, "energy": energy,
        "entropy": lambda self, z: z.s, "reversible": lambda self, z, dE, dS: {"q": dE.p, "p": -dE.q},
        "irreversible": rub,
    })  # fmt: skip
    return Scenario("noisy", kind, {}, initial={"q": 1.0, "p": 0.0, "s": 0.0}, t_end=1.0, dt=0.1)


@pytest.mark.parametrize("method", ["tc_monolithic", "scipy_odeint"])
@pytest.mark.parametrize(("kind", "where"), [*((kind, "irreversible") for kind in NOISE), ("numpy", "energy")])
def test_a_formula_that_changes_is_refused_wherever_it_is_used(kind, where, method):
    with pytest.raises(TcbenchError, match=rf"test_no_noise.py, line \d+: {where}\(\) of Noisy is not the same"):
        tcbench.simulate(method, noisy(NOISE[kind], where))


@pytest.mark.parametrize("method", ["tc_monolithic", "scipy_odeint"])
def test_so_is_one_of_elements(method):
    pendulum = tcbench.scenarios()["short_term"]

    class Warm(pendulum.system):
        def conduction(self, theta):
            return (1 + np.random.random()) * super().conduction(theta)  # noqa: NPY002

    assert issubclass(Warm, ElementSystem)
    scenario = Scenario(
        "warm", Warm, pendulum.constants, pendulum.positions, pendulum.momenta, pendulum.temperatures, t_end=1, dt=0.1
    )
    with pytest.raises(TcbenchError, match="is not the same when it is called again"):
        tcbench.simulate(method, scenario)


def test_so_is_one_of_a_method():
    def formula(z0, z1, h, system):
        return z1 - z0 - h * (1 + np.random.random()) * system.vector_field(z0)  # noqa: NPY002

    with pytest.raises(TcbenchError, match="the residual 'formula', or a formula that it reads, is not the same"):
        tcbench.simulate(Integrator(name="noise", order=1, flows=formula), "short_term")
