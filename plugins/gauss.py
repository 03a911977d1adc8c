"""Textbook Gauss collocation: order 2k, momenta exact, energy not; for comparison with tc_gauss."""

import numpy as np

from tcbench import Flow, Integrator, hookimpl

ROOT3, ROOT15 = np.sqrt(3.0), np.sqrt(15.0)
TABLEAUX = {  # Hairer, Norsett & Wanner, Solving ODEs I, II.7
    2: (np.array([[1 / 4, 1 / 4 - ROOT3 / 6], [1 / 4 + ROOT3 / 6, 1 / 4]]), np.array([1 / 2, 1 / 2])),
    3: (
        np.array([
            [5 / 36, 2 / 9 - ROOT15 / 15, 5 / 36 - ROOT15 / 30],
            [5 / 36 + ROOT15 / 24, 2 / 9, 5 / 36 - ROOT15 / 24],
            [5 / 36 + ROOT15 / 30, 2 / 9 + ROOT15 / 15, 5 / 36],
        ]),
        np.array([5 / 18, 4 / 9, 5 / 18]),
    ),
}  # fmt: skip


def collocation(k):
    A, b = TABLEAUX[k]

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
        for k in TABLEAUX
    ]
