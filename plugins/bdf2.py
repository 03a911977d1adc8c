"""BDF2: the slope at z1 of the parabola through the last two states and z1. A-stable, and no law of its own."""

from tcbench import Integrator, hookimpl


def bdf2(z0, z1, h, system, before):
    return z1 - z0 - (z0 - before[0]) / 3 - 2 / 3 * h * system.vector_field(z1)


@hookimpl
def tcbench_integrators():
    source = "Curtiss and Hirschfelder (1952)"
    return [
        Integrator("bdf2", 2, source=source, flows=bdf2, memory=1, starter="tc_monolithic", by_default=False),
    ]
