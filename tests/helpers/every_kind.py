"""Runs by methods of every kind: formulas, steps, marches, adaptive solvers, wrappers and an author's own."""

import numpy as np
from tcbench_plugins.controlled import controlled
from tcbench_plugins.projected import projected

import tcbench
from tcbench import Integrator
from tcbench.plugins import find_integrator, find_scenario


def richardson(z, h, system):
    step = tcbench.stepper("tc_monolithic", system)
    return (4 * step(step(z, h / 2), h / 2) - step(z, h)) / 3


def bdf2(z0, z1, h, system, before):
    return z1 - z0 - (z0 - before[0]) / 3 - 2 / 3 * h * system.vector_field(z1)


def adams(z, h, system, before):
    return z + h * (1.5 * system.vector_field(z) - 0.5 * system.vector_field(before[0]))


def with_arrays(z, h, system, work):
    work[:] = z + h / 2 * system.vector_field(z)
    return z + h * system.vector_field(work)


OWN = {
    method.name: method
    for method in (
        Integrator(name="richardson", order=4, step=richardson),
        Integrator(name="bdf2", order=2, memory=1, starter="tc_monolithic", flows=bdf2),
        Integrator(name="adams", order=2, memory=1, starter="tc_gauss", step=adams),
        Integrator(name="arrays", order=2, step=with_arrays, workspace=lambda system: np.empty(system.size)),
        controlled(find_integrator("tc_taylor[order=8]"), name="controlled_taylor"),
        projected(find_integrator("tc_gauss"), name="projected_gauss"),
    )
}
KINDS = [  # of every kind of method
    "tc_strang", "midpoint_temperature", "verlet_heat",  # formulas
    "tc_gauss", "tc_taylor[order=8]",  # with a march
    "tc_auto", "controlled[method=tc_monolithic]", "projected[method=scipy_dopri5]", "scipy_odeint", "solve_ivp_lsoda",
    *OWN,
]  # fmt: skip
CASES = [
    *((name, "bound_equilibrium") for name in KINDS),
    ("tc_monolithic", "net[nx=3,ny=3]"), ("tc_gauss", "net[nx=3,ny=3]"), ("tc_monolithic", "gas_containers"),
]  # fmt: skip


def variants(name):
    """Scenarios of one structure with other constants and another start."""
    scenario = find_scenario(name).replace(t_end=0.5)
    warmer = tuple(theta + 1.0 for theta in scenario.temperatures)
    return [scenario, scenario.replace(reference_temperature=301.0), scenario.replace(temperatures=warmer)]


def settings(method, dt=0.02, tolerance=1e-5):
    return {"tolerance": tolerance} if method.kind == "adaptive" else {"dt": dt}


def method_of(name):
    return OWN.get(name) or find_integrator(name)


def told(run):
    """All that is computed, to the last bit."""
    numbers = run.z.tobytes(), run.energy.tobytes()
    return run.status, run.failure, *numbers, repr(run.solver), run.summary.energy_error_max


def simulate(name, scenario, **given):
    method = method_of(name)
    return told(tcbench.simulate(method, scenario, **settings(method, **given)))


def ids(case):
    return "-".join(case)
