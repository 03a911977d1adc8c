"""The same formula gives the same text, and so the same kernel, whatever was traced before in the process."""

import numpy as np

import tcbench
from tcbench.compiler import derivatives as trace
from tcbench.integrator import Flow
from tcbench.solver.flow_kernels import build

SCENARIO = tcbench.scenarios()["short_term"]


def backwards(z0, z1, h, system):
    """Differences and sums in the order that no other method has."""
    DE = np.asarray(system.gradient((z1 + z0) / 2))
    return (z0 - z1) + h * (system.L @ DE + system.dissipation(DE[8:])) + (z1 - z0) * 2


def texts():
    """Everything that a step of the monolithic method computes."""
    kernels = build(tcbench.integrators()["tc_monolithic"].flows[0], SCENARIO.model)
    made = [kernels.setup, kernels.prologue, kernels.opening, kernels.iterate, kernels.polish, kernels.finish]
    observe = SCENARIO.model.formula("observe")[0]
    return [*(k.text for k in made), kernels.full.text, observe]


def test_a_kernel_s_text_does_not_depend_on_what_was_traced_before():
    before = texts()
    z = trace.variables("z", SCENARIO.model.size)  # outside any trace of its own, and kept alive
    kept = [SCENARIO.model.symbolic.vector_field(z), backwards(z, 2 * z, 1.0, SCENARIO.model.symbolic)]
    build(Flow(backwards), SCENARIO.model)
    build(tcbench.integrators()["midpoint_entropy"].flows[0], SCENARIO.model)
    assert texts() == before and len(kept) == 2
