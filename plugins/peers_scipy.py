"""SciPy's solvers, each through its fastest door, with the compiled right-hand side and the exact Jacobian.

What a user would pick instead. They know nothing of energy, momentum or entropy: no claims.
"""

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.systems.right_hand_side import Field

DENSE = 80  # length of a state up to which a dense Jacobian is the faster one
IMPLICIT = ("Radau", "BDF", "LSODA")


def odeint(system, z0, t_eval, rtol, atol):
    """LSODA behind SciPy's oldest door: a third of the overhead of solve_ivp's."""
    import scipy.integrate

    field = Field(system)
    states, info = scipy.integrate.odeint(
        field.shared, z0, t_eval, Dfun=field.jacobian, tfirst=True, rtol=rtol, atol=atol, mxstep=10_000_000,
        full_output=True,
    )  # fmt: skip
    if info["message"] != "Integration successful.":
        raise RuntimeError(f"odeint: {info['message']}")
    return states, {"steps": int(info["nst"][-1]), "rhs_evaluations": field.evaluations}


def door_of_ode(name, stages):
    """Dormand and Prince's programs, called by `scipy.integrate.ode`; `stages` right-hand sides a step."""

    def adaptive(system, z0, t_eval, rtol, atol):
        import scipy.integrate

        field = Field(system)
        solver = scipy.integrate.ode(field.shared).set_integrator(name, rtol=rtol, atol=atol, nsteps=10_000_000)
        solver.set_initial_value(z0, t_eval[0])
        states = [z0]
        for t in t_eval[1:]:
            states.append(solver.integrate(t).copy())
            if not solver.successful():
                raise RuntimeError(f"{name} stopped before t = {t:g} (code {solver.get_return_code()})")
        return np.array(states), {"steps": field.evaluations // stages, "rhs_evaluations": field.evaluations}

    return adaptive


def door_of_solve_ivp(method):
    def adaptive(system, z0, t_eval, rtol, atol):
        import scipy.integrate

        field = Field(system)
        extra = {"jac": field.jacobian} if method in IMPLICIT else {}
        if extra and method != "LSODA" and system.size > DENSE:
            from tcbench.systems.sparse_jacobian import sparse_jacobian  # networks, when there is one

            jacobian = sparse_jacobian(system)
            extra = {"jac": lambda t, z: jacobian(z)}
        solution = scipy.integrate.solve_ivp(
            field.rate,
            (t_eval[0], t_eval[-1]),
            z0,
            method,
            t_eval if len(t_eval) > 2 else None,
            rtol=rtol,
            atol=atol,
            **extra,
        )
        if not solution.success:
            raise RuntimeError(f"solve_ivp {method}: {solution.message}")
        counts = {"rhs_evaluations": int(solution.nfev)}
        if len(t_eval) > 2:
            return solution.y.T, counts
        return solution.y.T[[0, -1]], counts | {"steps": len(solution.t) - 1}

    return adaptive


def peer(name, adaptive, source):
    return Integrator(name=name, adaptive=adaptive, source=source, tags={"peer", "scipy"})


@hookimpl
def tcbench_integrators():
    doors = [peer("scipy_odeint", odeint, "scipy.integrate.odeint (ODEPACK LSODA)")]
    for name, stages in (("dopri5", 6), ("dop853", 11)):
        doors.append(peer(f"scipy_{name}", door_of_ode(name, stages), f"scipy.integrate.ode, {name} (Hairer)"))
    for method in ("RK45", "DOP853", "Radau", "BDF", "LSODA"):
        doors.append(
            peer(f"solve_ivp_{method.lower()}", door_of_solve_ivp(method), f"scipy.integrate.solve_ivp {method}")
        )
    return doors
