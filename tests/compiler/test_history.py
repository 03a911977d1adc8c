"""The same formula gives the same text, and so the same last digits, whatever was traced before in the process."""

import subprocess
import sys

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
    for name in ("midpoint_entropy", "tc_strang"):
        for flow in tcbench.integrators()[name].flows:
            build(flow, SCENARIO.model)
    assert texts() == before and len(kept) == 2


def test_a_run_has_the_same_bits_alone_and_after_others():
    code = (
        "import sys, tcbench\n"
        "for name in sys.argv[1:]:\n"
        "    run = tcbench.simulate(name, 'stiff_spring', t_end=6.0)\n"
        "    print(name, *(x.hex() for x in run.z[-1]))\n"
    )
    orders = (["tc_monolithic"], ["tc_gauss"], ["tc_gauss", "midpoint_entropy", "tc_monolithic"],
              ["tc_gauss_adaptive", "tc_monolithic", "tc_gauss"])  # fmt: skip
    found: dict[str, set] = {}
    for names in orders:
        done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, check=True)
        for line in done.stdout.splitlines():
            found.setdefault(line.split()[0], set()).add(line)
    assert {name: len(lines) for name, lines in found.items()} == dict.fromkeys(found, 1)
