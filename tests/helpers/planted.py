"""Methods with which `tcbench check` is tried."""

from tcbench import Integrator


def explicit_midpoint(z, h, system):
    return z + h * system.vector_field(z + h / 2 * system.vector_field(z))


def implicit_midpoint(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field((z0 + z1) / 2)


def made(**settings):
    return Integrator(**({"name": "planted", "order": 2, "source": "a test"} | settings))
