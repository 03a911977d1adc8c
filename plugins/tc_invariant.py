"""The paper's monolithic method, which keeps every invariant that a system declares, whatever it is and however the
energy is written.

v = L DE + M DS keeps DE . v = 0 and DS . v >= 0, but J(z1) - J(z0) = h DJ . v is 0 only where J is quadratic and the
discrete gradient of E is as invariant as E. To h v is added a small move c of slopes, in units of the state,

    z1 - z0 = h v + c,   c = sum_k a_k W D_k,   D_k of E, of every J that v does not keep, and of S,
    DE . (z1 - z0) = 0,   DJ . (z1 - z0) = 0,   DS . c = 0.

The a_k are unknowns of the step: energy, entropy production and every J are exact. At the true gradients DJ . v = 0, so
c = O(h^3): order 2, and symmetric. Where v keeps all, this is tc_monolithic. At an equilibrium a slope is made of the
others, DE = theta DS + omega DJ: as little as is left of it beside those before it, as much is its a_k damped. S is the
last: energy and invariants stay exact there, and S may fall by round-off.
"""

from tcbench import Flow, Integrator, hookimpl
from tcbench.compiler.derivatives import const, lifted
from tcbench.solver.invariance import lost_invariants
from tcbench.solver.mending import product

DEPENDENT = 1e-10  # of the square of a slope, its part free of the others: less is damped
NONE = 1e-30  # beside a square that may be 0


def held(system):
    """What is kept by a move: energy, invariants that would be lost, and entropy; nothing where none would be."""
    lost = lost_invariants(system)
    return ("energy", *lost, "entropy") if lost else ()


def tc_invariant(z0, z1, h, system, shares=None):
    DE, DS = system.discrete_gradients(z0, z1)
    mid = (z0 + z1) / 2
    rows = z1 - z0 - h * (system.reversible(mid, DE, DS) + system.irreversible(mid, DE, DS))
    if not shares:
        return rows
    weights = system.least_of(z0) ** 2
    slopes = [DE, *invariant_slopes(system, shares, system.momenta_discrete_gradients(z0, z1)), DS]
    still = [system.gradient(z0), *invariant_slopes(system, shares, system.momenta_gradients(z0)), system.entropy_gradient(z0)]
    sizes, damping = independent(system, still, weights)
    move = sum(weights * slope * (a * size) for slope, a, size in zip(slopes, shares.values(), sizes, strict=True))
    ends = [z1 - z0] * (len(slopes) - 1) + [move]
    equations = [
        lifted(product(system, slope, end)) * size + keep * a
        for slope, end, size, keep, a in zip(slopes, ends, sizes, damping, shares.values(), strict=True)
    ]
    return rows - move, equations


def invariant_slopes(system, shares, found):
    return [slope for name, slope in zip(system.invariant_names, found, strict=True) if name in shares]


def independent(system, slopes, weights):
    """1 over the size of each slope, and the damping of its share: by Gram and Schmidt, what is left of it is free."""
    gram = [[lifted(product(system, x, weights * y)) for y in slopes] for x in slopes]
    sizes = [1 / (gram[k][k] + NONE) ** 0.5 for k in range(len(slopes))]
    pivots, lower, damping = [], [], []
    for i in range(len(slopes)):
        row = []
        for j in range(i):
            rest = gram[i][j] * sizes[i] * sizes[j]
            row.append((rest - sum((row[k] * lower[j][k] * pivots[k] for k in range(j)), const(0.0))) / pivots[j])
        left = const(1.0) - sum((x * x * pivot for x, pivot in zip(row, pivots, strict=True)), const(0.0))
        damping.append(DEPENDENT**2 / (abs(left) + NONE))
        pivots.append(abs(left) + damping[-1])
        lower.append(row)
    return sizes, damping


def refuses(system):
    return (
        "a system with constraints has its multipliers in DE, which this method holds to" if system.multipliers else ""
    )


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_invariant",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eq. (6), onto invariants (Gonzalez 1996; McLachlan, Quispel, Robidoux 1999)",
            flows=Flow(tc_invariant, numbers=held),
            refuses=refuses,
        )
    ]
