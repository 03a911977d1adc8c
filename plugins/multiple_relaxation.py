"""Multiple relaxation: a Runge-Kutta step whose stages are weighed anew so that both laws hold at once; explicit.

The step ends in z~ = z0 + h sum b_i f_i, f_i = f(Y_i), and misses both laws by O(h^(p+1)). With other weights,

    z1 = z~ + h sum_i g_i f_i,
    E(z1) = E(z0),   S(z1) = S(z0) + h sum b_i grad S(Y_i) . f_i,

the energy is exact, and the entropy grows by its own quadrature, each term of which is grad S . M grad S >= 0, so that
it never falls. The weights are those of the shortest move, along the parts of grad E and grad S that the stages span.
Other invariants are not corrected: at small steps the stages are nearly parallel and do not span the slopes of more
laws.
"""

from tcbench import Flow, Integrator, family, hookimpl
from tcbench.compiler.derivatives import lifted
from tcbench.solver.mending import Along, product

from .relaxation import TABLEAUX

DEPENDENT = 1e-10  # part of a rate that is free of earlier ones, below which it is round-off
NOT_ZERO = 1e-300  # added to squares of rates, which may be 0
AT_REST = 1e-10  # part of |DS|^2 that is free of DE, below which corrections along it are damped
MAX_SLOPES = 10  # corrections of a step, each with new slopes


def stages(order, z0, h, system):
    """States Y_i and rates f_i of an explicit method, and its weights."""
    A, b = TABLEAUX[order]
    states, rates = [], []
    for row in A:
        moves = [h * a * f for a, f in zip(row, rates, strict=True) if a]
        states.append(system.state(z0 + sum(moves[1:], moves[0])) if moves else system.state(z0))
        rates.append(system.vector_field(states[-1]))
    return states, rates, b


def orthogonal(system, rates, units):
    """Orthogonal directions (s, n) with the span of the rates, in the metric of `units`; dependent ones become 0."""
    basis = []
    for f in rates:
        rest = f
        for e in (*basis, *basis):  # twice is enough (Parlett)
            rest = rest - e * lifted(product(system, e, rest / units))
        square = lifted(product(system, f, f / units))
        basis.append(rest / (lifted(product(system, rest, rest / units)) + DEPENDENT**2 * square + NOT_ZERO) ** 0.5)
    return basis


def runge_kutta(order):
    def residual(z0, z1, h, system):
        _, rates, b = stages(order, z0, h, system)
        return z1 - z0 - sum(h * w * f for w, f in zip(b, rates, strict=True) if w)

    return residual


def weighed_anew(order):
    def corrections(z0, z1, h, system, start, first, moved):
        """The correction of z1, (n,), to the energy of the run and the entropy that the stages produce."""
        states, rates, b = stages(order, start, h, system)
        directions = orthogonal(system, rates, system.magnitudes_of(start) ** 2)

        def combined(slope):
            return sum(e * lifted(product(system, slope, e)) for e in directions)

        produced = sum(
            h * w * lifted(product(system, system.entropy_gradient(Y), f))
            for Y, f, w in zip(states, rates, b, strict=True)
            if w
        )
        along = Along(system, [system.gradient(z0), system.entropy_gradient(z0)], combined, AT_REST)
        wanted = system.energy(first), system.entropy(start) + produced
        values = along.before([system.energy(z1), system.entropy(z1)], moved)
        return moved - along.move([target - f for target, f in zip(wanted, values, strict=True)])

    return corrections


def multiple_relaxation(order="4"):
    p = int(order)
    return Integrator(
        name="multiple_relaxation",
        order=p,
        claims={"energy", "entropy"},
        source="Biswas and Ketcheson (2023), SIAM J. Sci. Comput. 45: A3305-A3331; Ranocha et al. (2020)",
        flows=[Flow(runge_kutta(p)), Flow(weighed_anew(p), of_step=True, most=MAX_SLOPES)],
        tags={"explicit", "projected"},
        by_default=False,
    )


@hookimpl
def tcbench_integrators():
    return [family(multiple_relaxation, order=(4, 2, 3))]
