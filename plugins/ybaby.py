"""YBABY and mYBABY: half a step of the irreversible part (Y), a Verlet step (B, A, B), half a step of Y.

Verlet's step conserves a modified energy, H~ = H + h^2 (v.U''v/12 - g.M^-1 g/24) + O(h^4), with g = grad U, v = M^-1 p.
mYBABY takes that for H in the irreversible part, whose own degeneracy is then that of what the reversible part keeps.

Y is the explicit midpoint rule; exact where friction is linear in the momenta and all heat goes into one entropy. Both
need q and p with H = K(p) + U(q, the rest) and a reversible part that is Hamilton's. Entropy never falls, for the
entropies do not move in B and A, and angular momentum is kept; of the energy neither keeps more than its order.
"""

import numpy as np

from tcbench import ElementSystem, Integrator, hookimpl
from tcbench.compiler import derivatives as trace
from tcbench.compiler.caches import cached_per_system
from tcbench.compiler.chain_rule import discrete_gradient, gradient

ANOTHER = "take a method for every system, such as tc_monolithic"


@cached_per_system
def hamiltonian(system):
    """Is the reversible part Hamilton's with H = K(p) + U(q, the rest)?"""
    if isinstance(system, ElementSystem):
        return True
    sym, names = system.symbolic, system.variables
    if names.get("q", 0) != names.get("p", 1):
        return False
    z, dE, dS = (sym.state(trace.variables(name, system.size)) for name in ("z", "E", "S"))
    rate = sym.reversible(z, dE, dS)
    expected = {name: np.ravel(0 * getattr(dE, name)) for name in names} | {"q": np.ravel(dE.p), "p": -np.ravel(dE.q)}
    actual = {name: np.ravel(getattr(rate, name)) for name in names}
    if any(a is not b for name in names for a, b in zip(actual[name], expected[name], strict=True)):
        return False
    slope, p = sym.gradient(z), list(np.ravel(z.p))
    rest = [x for name in names if name != "p" for x in np.ravel(getattr(z, name))]
    of_p, of_rest = (np.ravel(slope.p), [x for n in names if n != "p" for x in np.ravel(getattr(slope, n))])
    return not under(of_p, rest) and not under(of_rest, p)


def under(formulas, variables):
    """Do any of the formulas depend on any of the variables?"""
    moving = trace.depends_on([trace.lifted(f) for f in formulas], variables)
    return any(trace.lifted(f).number in moving for f in formulas)


def refuses(system):
    if system.large:
        numbers = f"the {system.size} of {system.name} are traced on arrays"
        return f"its formulas take the numbers of a state one by one, and {numbers}: {ANOTHER}"
    if system.multipliers:
        return f"its explicit kicks do not solve for the multipliers of {system.name}: {ANOTHER}"
    if hamiltonian(system):
        return ""
    return f"it needs positions q and momenta p with H = K(p) + U(q, the rest), which {system.name} has not: {ANOTHER}"


def verlet(z0, z1, h, system):
    """Half a kick, a drift, half a kick."""

    def kick(z):
        return h / 2 * np.ravel(system.gradient(z).q)

    def moved(z, **by):
        parts = [np.ravel(getattr(z, n)) + by.get(n, 0.0) for n in system.variables]
        return system.state(np.concatenate(parts))

    kicked = moved(z0, p=-kick(z0))
    drifted = moved(kicked, q=h * np.ravel(system.gradient(kicked).p))
    return z1 - moved(drifted, p=-kick(drifted))


def modified_energy(system, z, h):
    """H~ of Verlet's step of length h."""
    slope = system.gradient(z)
    q, p, g, v = (list(np.ravel(x)) for x in (z.q, z.p, slope.q, slope.p))
    stiff = sum(a * b * x for a, row in zip(v, trace.jacobian(g, q), strict=True) for b, x in zip(v, row, strict=True))
    light = sum(a * b * x for a, row in zip(g, trace.jacobian(v, p), strict=True) for b, x in zip(g, row, strict=True))
    return system.energy(z) + h * h * (stiff / 12 - light / 24)


def irreversible(modified):
    def residual(z0, z1, h, system):
        z = system.state(trace.variables("z", system.size))
        E = modified_energy(system, z, 2 * h) if modified else trace.lifted(system.energy(z))  # h is half a step here
        dE, dS = system.state(trace.array(gradient(E, list(z)))), system.entropy_gradient(z)
        rate = np.asarray(_conducted(system, z, dE) if modified else system.irreversible(z, dE, dS))

        def at(state):
            return trace.array(trace.substitute(list(map(trace.lifted, rate)), dict(zip(z, state, strict=True))))

        if (decay := _decay(system, z, E, rate)) is None:
            return z1 - z0 - h * at(z0 + h / 2 * at(z0))
        return z1 - z0 - _decayed(system, z, E, decay, z0, h)

    return residual


def _conducted(system, z, dE):
    """The irreversible part at the temperatures of the modified energy; for two elements with the coefficient of the
    conduction at their own temperatures, as in the authors' programs."""
    if isinstance(system, ElementSystem) and system.n_elements == 2:
        (a, b), own = dE.s, system.temperatures(z)
        coefficient = system.friction(own)[0, 0] / own[1] ** 2
        still = [trace.const(0.0)] * (2 * system.n_positions)
        return np.array([*still, coefficient * b * (b - a), coefficient * a * (a - b)])
    return system.irreversible(z, dE, system.entropy_gradient(z))


def _decay(system, z, E, rate):
    """Rates of decay of the momenta where the flow of Y is known, d in dp/dt = d p: with nothing but p and one entropy
    moving, at a temperature that does not."""
    if set(system.variables) != {"q", "p", "s"} or system.variables["s"] != ():
        return None
    p, rates = list(np.ravel(z.p)), list(np.ravel(system.state(rate).p))
    slopes, nothing = trace.jacobian(rates, p), dict.fromkeys(p, trace.const(0.0))
    d = np.diagonal(slopes)
    aside = [slopes[i, j] for i in range(len(p)) for j in range(len(p)) if i != j]
    constant = not under([*d, *trace.jacobian([E], [z.s])[0]], [*p, z.s])
    zero = all(trace.is_const(x, 0.0) for x in [*aside, *trace.substitute(rates, nothing)])
    return d if constant and zero else None


def _decayed(system, z, E, decay, z0, h):
    """Increments of Y: the momenta decay, and the energy that they lose is heat."""
    here = dict(zip(z, z0, strict=True))
    dp = np.ravel(z0.p) * [np.expm1(h * x) for x in trace.substitute(list(decay), here)]
    step = system.state(trace.array([trace.const(0.0)] * system.size))
    parts = {"q": np.ravel(step.q), "p": dp, "s": np.ravel(step.s)}
    step = np.concatenate([parts[name] for name in system.variables])
    slopes = system.state(trace.array(discrete_gradient(E, list(z), list(z0), list(step))))
    parts["s"] = [-(np.ravel(slopes.p) @ dp) / slopes.s]
    return np.concatenate([parts[name] for name in system.variables])


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name=name,
            order=2,
            claims={"entropy", "angular_momentum"},
            source="Shang and Ottinger (2020), doi 10.1098/rspa.2019.0446",
            flows=[(irreversible(modified), 1 / 2), (verlet, 1), (irreversible(modified), 1 / 2)],
            refuses=refuses,
            tags={"explicit"},
            by_default=False,
        )
        for name, modified in (("ybaby", False), ("mybaby", True))
    ]
