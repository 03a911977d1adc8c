"""diffrax: Runge-Kutta methods with step control, compiled by XLA; formulas and Jacobian go through JAX."""

import numpy as np

from tcbench import Integrator, family, hookimpl
from tcbench.compiler import ops
from tcbench.systems.right_hand_side import expressions

SOLVERS = {"kvaerno5": "Kvaerno5", "dopri8": "Dopri8"}  # the first, implicit, is the default
MOST_STEPS = 1_000_000
_COMPILED = {}  # XLA takes seconds for each kind of system, solver and number of output times


def compiled(system, name, count):
    """solve(z0, times, constants, rtol, atol) -> (states, steps, result) for this kind of system."""
    import diffrax
    import jax
    import jax.numpy as jnp
    import optimistix

    chosen = getattr(diffrax, SOLVERS[name])
    implicit = issubclass(chosen, diffrax.AbstractImplicitSolver)
    # with diffrax's own chord method half of all steps are rejected and a run takes 4 to 7 times as long
    method = chosen(root_finder=diffrax.with_stepsize_controller_tols(optimistix.Newton)()) if implicit else chosen()
    functions = {name: getattr(jnp, name) for name in ops.functions() if hasattr(jnp, name)}
    unknowns, constant_places = range(system.size), range(len(system.constant_values))

    def rate(t, z, c):
        return jnp.stack(expressions(system, [z[i] for i in unknowns], [c[i] for i in constant_places], functions))

    @jax.jit
    def solve(z0, times, constants, rtol, atol):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate), method, times[0], times[-1], None, z0, constants,
            saveat=diffrax.SaveAt(ts=times), stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
            max_steps=MOST_STEPS, throw=False,
        )  # fmt: skip
        return solution.ys, solution.stats["num_accepted_steps"], solution.result

    return solve


def diffrax_peer(solver="kvaerno5"):
    def adaptive(system, z0, t_eval, rtol, atol):
        import diffrax
        import jax

        with jax.enable_x64(True):  # doubles here, whatever the rest of the process uses
            key = (system.structure, solver, len(t_eval))
            if key not in _COMPILED:
                _COMPILED[key] = compiled(system, solver, len(t_eval))
            arguments = (
                np.asarray(x, dtype=float) for x in (z0, t_eval, system.constant_values, rtol, system.absolute(atol))
            )
            states, steps, result = _COMPILED[key](*arguments)
            states = np.array(states)
        if not result == diffrax.RESULTS.successful:
            raise ArithmeticError(f"diffrax {solver}: {diffrax.RESULTS[result] or 'it gave up'}")
        return states, {"steps": int(steps)}

    return Integrator(
        name="diffrax", adaptive=adaptive, source=f"diffrax {solver}, PID step control", tags={"peer"},
        requires=["diffrax", "jax"],
    )  # fmt: skip


@hookimpl
def tcbench_integrators():
    return [family(diffrax_peer, solver=tuple(SOLVERS))]
