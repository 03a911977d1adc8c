"""heyoka's adaptive Taylor method of high order: the formulas of the system as expressions, compiled by heyoka."""

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.compiler import ops
from tcbench.systems.right_hand_side import expressions

LIMIT = 200  # length of a state: heyoka compiles its formulas in seconds, longer ones in minutes
_FREE = {}  # free integrators by kind of system and tolerance: heyoka takes a second to make one


def compiled(system, tolerance, own):
    """An integrator for this kind of system and tolerance; constants are run-time parameters. It has one scale for all
    numbers: where magnitudes differ from 1, each number is divided by its own."""
    import heyoka as hy

    unknown = [hy.make_vars(f"x{i}") for i in range(system.size)]  # a single name would not give a list
    constants = [hy.par[i] for i in range(len(system.constant_values))]
    functions = {name: getattr(hy, name) for name in ops.functions() if hasattr(hy, name)} | {"pow": pow}
    sizes = constants[len(constants) - len(system.magnitudes) :]
    each = [size for size, (a, b, _) in zip(sizes, system.layout.values(), strict=False) for _ in range(a, b)]
    state = unknown if own else [x * size for x, size in zip(unknown, each, strict=True)]
    rates = [hy.expression(r) if isinstance(r, float) else r for r in expressions(system, state, constants, functions)]
    rates = rates if own else [r / size for r, size in zip(rates, each, strict=True)]
    equations = list(zip(unknown, rates, strict=True))
    return hy.taylor_adaptive(equations, np.ones(system.size), tol=tolerance)


def refuses(system):
    n = system.size
    if n > LIMIT:
        reason = f"heyoka compiles a formula for each of the {n} numbers of {system.name}, at most {LIMIT}"
        return f"{reason}: take tc_taylor"
    kinked = "abs(" in system.formula("vector_field")[0]
    return f"the rates of {system.name} use abs, which heyoka does not have: take tc_taylor" if kinked else ""


def heyoka(system, z0, t_eval, rtol, atol):
    each = system.unit_sizes
    free = _FREE.setdefault((system.structure, float(rtol), each is None), [])
    try:
        solver = free.pop()
    except IndexError:
        solver = compiled(system, float(rtol), each is None)
    try:
        return outputs(solver, system, z0, t_eval, each)
    finally:
        free.append(solver)


def outputs(solver, system, z0, t_eval, each):
    """(states at the times, counts); the solver is reset."""
    solver.state[:] = z0 if each is None else z0 / each
    solver.pars[:] = system.constant_values[: len(solver.pars)]
    solver.time = float(t_eval[0])
    states, steps = [np.array(z0)], 0
    for t in t_eval[1:]:
        outcome = solver.propagate_until(float(t))
        steps += int(outcome[3])
        if outcome[0].name != "time_limit":
            raise ArithmeticError(f"heyoka stopped before t = {t:g}: {outcome[0].name}")
        states.append(solver.state.copy() if each is None else solver.state * each)
    return np.array(states), {"steps": steps}


@hookimpl
def tcbench_integrators():
    source, needs = "heyoka, adaptive Taylor series", ["heyoka"]
    return [Integrator(name="heyoka", adaptive=heyoka, refuses=refuses, source=source, requires=needs, tags={"peer"})]
