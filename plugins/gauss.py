"""Textbook Gauss collocation: order 2k, momenta exact, energy not; for comparison with tc_gauss."""

import numpy as np

from tcbench import Flow, Integrator, hookimpl
from tcbench.reference.quadrature import gauss, integrals


def collocation(k):
    nodes, weights = gauss(k)
    A, b = integrals(nodes, nodes).astype(float), weights.astype(float)

    def residual(z0, z1, h, system, stages):
        rates = [system.vector_field(z) for z in stages]
        blocks = [
            z - z0 - h * sum(a * f for a, f in zip(row, rates, strict=True)) for z, row in zip(stages, A, strict=True)
        ]
        return np.concatenate([z1 - z0 - h * sum(w * f for w, f in zip(b, rates, strict=True)), *blocks])

    return residual


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name=f"gauss{k}",
            order=2 * k,
            claims={"angular_momentum"},
            source="Gauss collocation (Butcher 1964)",
            flows=Flow(collocation(k), stages=k),
        )
        for k in (2, 3)
    ]
