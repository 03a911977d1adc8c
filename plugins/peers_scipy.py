"""SciPy's solvers, those of solve_ivp step by step, with the compiled right-hand side and the exact Jacobian.

The usual alternative for a user. They do not use energy, momentum or entropy and claim nothing.
"""

from contextlib import contextmanager

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.systems.right_hand_side import Field

DENSE = 80  # length of a state up to which a dense Jacobian is the faster one
IMPLICIT = ("Radau", "BDF", "LSODA")
EXPLICIT = ("dopri5", "dop853", "rk45")  # take right-hand sides alone
NOT_FINITE = "array must not contain infs or NaNs"  # as SciPy says it


def odeint(system, z0, t_eval, rtol, atol):
    """LSODA by SciPy's oldest interface, with a third of the overhead of solve_ivp."""
    import scipy.integrate

    field = Field(system)
    states, info = scipy.integrate.odeint(
        field.shared, z0, t_eval, Dfun=field.jacobian, tfirst=True, rtol=rtol, atol=system.absolute(atol),
        mxstep=10_000_000, full_output=True,
    )  # fmt: skip
    if info["message"] != "Integration successful.":
        raise ArithmeticError(f"odeint: {info['message']}")
    return states, {"steps": int(info["nst"][-1]), "rhs_evaluations": field.evaluations}


REASONS = {  # of failures of Dormand and Prince's programs, by return code
    -1: "its input is not consistent", -2: "it needs more steps", -3: "its step became too small",
    -4: "the problem is probably stiff",
}  # fmt: skip


def door_of_ode(name, stages):
    """Dormand and Prince's programs, called by `scipy.integrate.ode`; `stages` right-hand sides a step."""

    def begun(system, z0, t, rtol, atol):
        """A solver at the start. It takes one atol for all numbers: each is over its magnitude where that is not 1."""
        import scipy.integrate

        field, each = Field(system), system.unit_sizes
        rate = field.shared if each is None else lambda t, x: field.shared(t, x * each) / each
        solver = scipy.integrate.ode(rate).set_integrator(name, rtol=rtol, atol=atol, nsteps=10_000_000)
        return field, solver.set_initial_value(z0 if each is None else z0 / each, t), each

    def state_at(solver, t, each):
        state = solver.integrate(t)
        state = state.copy() if each is None else state * each
        if not solver.successful():
            code = solver.get_return_code()
            raise ArithmeticError(f"{name} stopped before t = {t:g}: {REASONS.get(code, f'code {code}')}")
        return state

    def adaptive(system, z0, t_eval, rtol, atol):
        field, solver, each = begun(system, z0, t_eval[0], rtol, atol)
        states = [z0]
        for t in t_eval[1:]:
            states.append(state_at(solver, t, each))
        return np.array(states), {"steps": field.evaluations // stages, "rhs_evaluations": field.evaluations}

    def outputs(system, z0, t_eval, rtol, atol):
        (field, solver, each), counts = begun(system, z0, t_eval[0], rtol, atol), {}

        def states():
            yield z0
            for t in t_eval[1:]:
                state = state_at(solver, t, each)
                counts.update(steps=field.evaluations // stages, rhs_evaluations=field.evaluations)
                yield state

        return states(), counts

    # called from a generator, dop853 of SciPy 1.17 evaluates each step's end twice, to the same result
    return (adaptive,) if name == "dop853" else (adaptive, outputs)


def door_of_solve_ivp(method):
    def extras(system, field):
        if method not in IMPLICIT:
            return {}
        if method != "LSODA" and system.size > DENSE:
            from tcbench.systems.sparse_jacobian import sparse_jacobian  # networks, when there is one

            jacobian = sparse_jacobian(system)
            return {"jac": lambda t, z: jacobian(z)}
        return {"jac": field.jacobian}

    def outputs(system, z0, t_eval, rtol, atol):
        """The loop of solve_ivp, one state after the other."""
        import scipy.integrate

        field, counts = Field(system), {}
        start, end = float(t_eval[0]), float(t_eval[-1])
        solver = getattr(scipy.integrate, method)(
            field.rate, start, z0, end, rtol=rtol, atol=system.absolute(atol), **extras(system, field)
        )

        solver.fun = field.rate  # SciPy's wrapper counts and checks each call

        def states():
            yield z0
            row, steps, passed = 1, 0, solver.direction * np.asarray(t_eval)
            while row < len(t_eval):
                with lost(method):
                    message = solver.step()
                if solver.status == "failed":
                    raise ArithmeticError(f"solve_ivp {method}: {message}")
                steps += 1
                here = np.searchsorted(passed, solver.direction * solver.t, side="right")
                if here > row:
                    between = solver.dense_output()(t_eval[row:here])
                    counts.update(steps=steps, rhs_evaluations=field.evaluations)
                    yield from between.T
                    row = here

        return states(), counts

    return whole(outputs), outputs


@contextmanager
def lost(method):
    """Where a state is no longer finite SciPy's linear algebra says so, and the solver does not catch it."""
    try:
        yield
    except ValueError as error:
        if NOT_FINITE not in str(error):
            raise
        raise ArithmeticError(f"solve_ivp {method}: {error}") from error


def whole(outputs):
    """The states of `outputs`, all of them."""

    def adaptive(system, z0, t_eval, rtol, atol):
        states, counts = outputs(system, z0, t_eval, rtol, atol)
        return np.array(list(states)), counts

    return adaptive


def peer(name, source, adaptive, outputs=None):
    tags = {"peer", "scipy"} | ({"explicit"} if name.endswith(EXPLICIT) else set())
    return Integrator(name=name, adaptive=adaptive, outputs=outputs, source=source, tags=tags)


@hookimpl
def tcbench_integrators():
    doors = [peer("scipy_odeint", "scipy.integrate.odeint (ODEPACK LSODA)", odeint)]
    for name, stages in (("dopri5", 6), ("dop853", 11)):
        doors.append(peer(f"scipy_{name}", f"scipy.integrate.ode, {name} (Hairer)", *door_of_ode(name, stages)))
    for method in ("RK45", "DOP853", "Radau", "BDF", "LSODA"):
        doors.append(
            peer(f"solve_ivp_{method.lower()}", f"scipy.integrate.solve_ivp {method}", *door_of_solve_ivp(method))
        )
    return doors
