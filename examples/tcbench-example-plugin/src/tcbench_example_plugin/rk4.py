"""The classical Runge-Kutta method: explicit, order 4, conserves nothing."""

from tcbench import Integrator, hookimpl


def rk4(z, h, system):
    f = system.vector_field
    k1 = f(z)
    k2 = f(z + h / 2 * k1)
    k3 = f(z + h / 2 * k2)
    k4 = f(z + h * k3)
    return z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@hookimpl
def tcbench_integrators():
    return [Integrator(name="example_rk4", order=4, source="Kutta (1901), Z. Math. Phys. 46: 435-453", step=rk4)]
