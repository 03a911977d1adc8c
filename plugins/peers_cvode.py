"""CVODE (SUNDIALS, variable-order BDF) through scikit-sundae, with compiled right-hand side and exact Jacobian."""

import warnings

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.systems.right_hand_side import Field


def jacobian(field, system, z0):
    """The options for CVODE: a dense Jacobian, or the entries of a sparse one by columns."""
    if not system.large:

        def dense(t, z, rate, out):
            out[:] = field.jacobian(t, z)

        return {"jacfn": dense}
    from scipy.sparse import csr_matrix

    from tcbench.systems.sparse_jacobian import sparse_jacobian

    entries = sparse_jacobian(system)
    rows = entries(z0)
    numbered = csr_matrix((np.arange(1, rows.nnz + 1), rows.indices, rows.indptr), rows.shape).tocsc()

    def sparse(t, z, rate, out):
        out[:] = entries(z).data[numbered.data - 1]

    return {"jacfn": sparse, "linsolver": "sparse", "sparsity": numbered}


def cvode(system, z0, t_eval, rtol, atol):
    from sksundae.cvode import CVODE

    field = Field(system)
    span = float(abs(t_eval[-1]))
    # a warning that the Jacobian is used beside its pattern; a block of `catch_warnings` would be of all threads
    warnings.filterwarnings("ignore", "Custom sparse Jacobian", module="sksundae")
    solver = CVODE(
        field.into, **jacobian(field, system, z0), rtol=rtol, atol=system.absolute(atol), max_num_steps=10_000_000,
        min_step=np.spacing(span), max_step=span,  # a lost run would try millions of steps below round-off in t
    )  # fmt: skip
    solution = solver.solve(np.asarray(t_eval), z0)
    if not solution.success:
        raise ArithmeticError(f"CVODE: {solution.message}")
    states = solution.y if len(t_eval) > 2 else solution.y[[0, -1]]
    counts = {"rhs_evaluations": field.evaluations}
    return states, counts if len(t_eval) > 2 else counts | {"steps": len(solution.t) - 1}


@hookimpl
def tcbench_integrators():
    source = "SUNDIALS CVODE, BDF"
    return [Integrator(name="cvode", adaptive=cvode, source=source, requires=["scikit-sundae"], tags={"peer"})]
