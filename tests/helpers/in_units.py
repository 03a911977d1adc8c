"""A scenario posed in other units: every number of it is one of its own over a unit that is a power of two."""

import inspect

import numpy as np

from tcbench import Scenario, System

SPRINGS = {  # exponents of kg, m, s, K
    "masses": (1, 0, 0, 0), "stiffness": (1, 2, -2, 0), "branch_stiffness": (1, 2, -2, 0),
    "natural_lengths": (0, 1, 0, 0), "anchors": (0, 1, 0, 0), "conductivity": (1, 2, -3, -1),
    "reference_temperature": (0, 0, 0, 1), "coupling": (1, 2, -2, -1), "heat_capacity": (1, 2, -2, -1),
    "viscosity": (1, 2, -1, 0), "positions": (0, 1, 0, 0), "momenta": (1, 1, -1, 0), "temperatures": (0, 0, 0, 1),
    "t_end": (0, 0, 1, 0), "dt": (0, 0, 1, 0), "t_converge": (0, 0, 1, 0),
}  # fmt: skip


def springs(scenario, powers):
    """One of springs, in units of 2^powers kg, m, s and K; and the unit of each number of its state, of its energy."""
    changes = {}
    for name, exponents in SPRINGS.items():
        value = getattr(scenario, name, scenario.constants.get(name))
        if value is not None:
            changes[name] = np.asarray(value) / 2.0 ** np.dot(exponents, powers)
    plain = ("t_end", "dt", "t_converge")
    changes = {n: float(x) if n in plain or np.ndim(x) == 0 else tuple(np.ravel(x)) for n, x in changes.items()}
    kg, m, s, K = 2.0 ** np.asarray(powers, dtype=float)
    energy = kg * m**2 / s**2
    layout, units = scenario.model.layout, np.ones(scenario.model.size)
    for name, unit in (("q", m), ("p", kg * m / s), ("s", energy / K)):
        units[slice(*layout[name][:2])] = unit
    return scenario.replace(**changes), units, energy


def general(scenario, units, energy=1.0, entropy=1.0, time=1.0):
    """Any other in a unit for each variable by name: a system whose formulas are those of it, of numbers in its own."""
    base, kind = scenario.model, type(scenario.model)
    sizes = [(units.get(name, 1.0), b - a) for name, (a, b, _) in base.layout.items()]
    each = np.concatenate([np.full(count, unit) for unit, count in sizes])

    def asked(name, *states):
        return inspect.unwrap(getattr(kind, name))(base, *states)

    def at(z):
        return base.state(np.asarray(z) * each)

    def covectors(dE, dS):
        return base.state(np.asarray(dE) * (energy / each)), base.state(np.asarray(dS) * (entropy / each))

    def rates(name):
        def formula(self, z, dE, dS):
            found = asked(name, at(z), *covectors(dE, dS))
            return {n: np.asarray(x) * (time / units.get(n, 1.0)) for n, x in found.items()}

        return formula

    written = {
        "name": f"{base.name} in units", "variables": dict(base.variables),
        "energy": lambda self, z: asked("energy", at(z)) / energy,
        "entropy": lambda self, z: asked("entropy", at(z)) / entropy,
        "reference_temperature": float(base.reference_temperature) * entropy / energy,
        "exergy_offset": lambda self: base.exergy_offset() / energy,
    }  # fmt: skip
    written |= {name: rates(name) for name in ("reversible", "irreversible") if base.defines(name)}
    if base.defines("temperature"):
        written["temperature"] = lambda self, z, dE, dS: (
            np.asarray(asked("temperature", at(z), *covectors(dE, dS))) * (entropy / energy)
        )
    if base.defines("measures"):
        written["measures"] = lambda self, z: asked("measures", at(z))
    if base.defines("invariants"):
        written["invariants"] = lambda self, z: asked("invariants", at(z))
    system = type("InUnits", (System,), written)
    z0 = scenario.z0 / each
    initial = {name: z0[a:b].reshape(shape) if shape else z0[a] for name, (a, b, shape) in base.layout.items()}
    times = {name: getattr(scenario, name) / time for name in ("t_end", "dt", "t_converge")}
    return Scenario(f"{scenario.name} in units", system, {}, initial=initial, **times), each, energy
