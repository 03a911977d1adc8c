"""The paper's monolithic method, which keeps every invariant that a system declares, whatever it is and however the
energy is written.

A step of L DE + M DS from z to z~ keeps E, and S does not fall; J changes where it is not quadratic, or where the
discrete gradient of E is not as invariant as E. Then z~ is moved along discrete gradients D_k from z to z~, W being
squares of units,

    z1 = z~ + W (sum_k a_k D_k + b DS),   D_k of E and of every J,
    DE . (z1 - z) = 0,   DJ . (z1 - z) = 0,   DS . (z1 - z~) = 0,

with discrete gradients DE, DJ from z to z1 and DS from z~ to z1: energy, entropy produced and every J are exact. What
z~ misses is O(h^3), so that the order is 2. The a_k and b, one for each law, are the only unknowns; of invariants
that say the same (Kepler's momentum, beside energy and the Runge-Lenz vector) some are enough. Where a step keeps
every J between any two states, nothing is moved.

Next to an equilibrium DS is made of DE and DJ: as little as is left of it, as much is b damped. Energy and invariants
stay exact, and S may fall by round-off. So is each a_k whose slope says nothing that the others do not.
"""

from tcbench import Flow, Integrator, hookimpl
from tcbench.compiler.derivatives import lifted
from tcbench.solver.invariance import to_hold
from tcbench.solver.mending import product

from .tc_monolithic import tc_monolithic

AT_REST = 1e-10  # of the square of DS, its part free of the others: less is damped
DEPENDENT = 1e-6  # the same of energy and invariants, of which one may say what the others do, as at rest
ROUND_OFF = 1e-15  # of such a square
NONE = 1e-30  # beside one that may be 0


def held(system):
    """Energy, invariants and entropy, where an invariant would be lost."""
    names = to_hold(system)
    return ("energy", *names, "entropy") if names else ()


def onto_invariants(z0, z1, h, system, start, first, shares=None):
    """z1 = z0 moved, where a step from `start` lost an invariant."""
    if not shares:
        return z1 - z0
    weights = system.least_of(z0) ** 2
    return onto_laws(system, shares, start, z0, z1, lambda slope: weights * slope, 0.0)


def onto_laws(system, shares, start, z0, z1, turned, produced):
    """z1 = z0 moved along slopes of the laws, each `turned` into a direction by a symmetric matrix, so that energy and
    invariants are those of `start` and the entropy is that of z0 and what is to be `produced`."""
    *a, b = shares.values()
    ways, sizes, left = free_parts(system, slopes_between(system, shares, start, z0), turned)
    rest, entropy = AT_REST**2 / (left[-1] + NONE), (left[-1] + NONE) ** 0.5
    move = sum(way * x for way, x in zip(ways, [*a, b / entropy], strict=True))
    *slopes, _ = slopes_between(system, shares, start, z1)
    DS = system.discrete_entropy_gradient(z0, z1)
    damping = [(DEPENDENT / (x + ROUND_OFF)) ** 8 for x in left]
    equations = [
        lifted(product(system, slope, z1 - start)) * size + keep * x
        for slope, size, keep, x in zip(slopes, sizes, damping, a, strict=False)
    ]
    made = (lifted(product(system, DS, move)) - produced) * sizes[-1]
    return z1 - z0 - move, [*equations, (entropy * made + rest * b) / (left[-1] + rest)]


def slopes_between(system, shares, z0, z1):
    """Of the energy, the invariants that are held, and the entropy."""
    DJ = system.momenta_discrete_gradients(z0, z1)
    chosen = [DJ[system.invariant_names.index(name)] for name in list(shares)[1:-1]]
    return [system.discrete_gradient(z0, z1), *chosen, system.discrete_entropy_gradient(z0, z1)]


def free_parts(system, slopes, turned):
    """Directions, each the part of a slope that leaves the laws before it alone (Gram and Schmidt); 1 over the size of
    each slope; and the square of its free part, over that of the slope."""
    ways, sizes, left = [], [], []
    for slope in slopes:
        way = turned(slope)
        size = 1 / (lifted(product(system, slope, way)) + NONE) ** 0.5
        way = way * size
        shares = [
            lifted(product(system, slope, other)) * size / (square + ROUND_OFF)
            for other, square in zip(ways, left, strict=True)
        ]
        for share, other in zip(shares, ways, strict=True):
            way = way - other * share
        ways.append(way)
        sizes.append(size)
        left.append(abs(lifted(product(system, slope, way)) * size))
    return ways, sizes, left


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_invariant",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eq. (6), onto invariants (Gonzalez 1996; McLachlan, Quispel, Robidoux 1999)",
            flows=[tc_monolithic, Flow(onto_invariants, of_step=True, numbers=held)],
            uses="tc_monolithic",
        )
    ]
