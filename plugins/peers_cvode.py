"""CVODE (SUNDIALS, variable-order BDF) through scikit-sundae, with compiled right-hand side and exact Jacobian."""

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.systems.right_hand_side import Field


def cvode(system, z0, t_eval, rtol, atol):
    from sksundae.cvode import CVODE

    field = Field(system)

    def jacobian(t, z, rate, out):
        out[:] = field.jacobian(t, z)

    span = float(abs(t_eval[-1]))
    solver = CVODE(
        field.into, jacfn=jacobian, rtol=rtol, atol=atol, max_num_steps=10_000_000,
        min_step=np.spacing(span), max_step=span,  # a lost run would try millions of steps below round-off in t
    )  # fmt: skip
    solution = solver.solve(np.asarray(t_eval), z0)
    if not solution.success:
        raise RuntimeError(f"CVODE: {solution.message}")
    states = solution.y if len(t_eval) > 2 else solution.y[[0, -1]]
    counts = {"rhs_evaluations": field.evaluations}
    return states, counts if len(t_eval) > 2 else counts | {"steps": len(solution.t) - 1}


@hookimpl
def tcbench_integrators():
    source = "SUNDIALS CVODE, BDF"
    return [Integrator(name="cvode", adaptive=cvode, source=source, requires=["scikit-sundae"], tags={"peer"})]
