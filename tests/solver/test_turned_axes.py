"""A step turns with its axes: whichever way the solvers find its root, it is the same root."""

import numpy as np
import pytest

import tcbench
from tcbench.analysis.theorems import turned
from tcbench.simulation.run import simulate

SCENARIO = tcbench.scenarios()["short_term"]
# step 63 of the random steps of the study `claims`: its curve of roots has four folds on the way to h
FOLDED = SCENARIO.replace(
    name="folded", positions=(0.465822, -0.583607, 3.15716, 0.446812), temperatures=(469.468, 258.95),
    momenta=(-1.29383, 2.23751, 1.5276, -0.603275), t_end=0.6871652497,
)  # fmt: skip


def end(method, scenario, angle, h):
    z = turned(scenario.z0, angle)
    there = scenario.replace(positions=tuple(z[:4]), momenta=tuple(z[4:8]))
    run = simulate(method, there, dt=h, t_end=h)
    assert run.ok, run
    return turned(run.z[-1], -angle)


@pytest.mark.parametrize("method", ["tc_gonzalez", "tc_monolithic", "tc_itoh_abe"])
def test_a_step_whose_curve_folds_ends_at_one_root_in_all_axes(method):
    ends = np.array([end(method, FOLDED, k * np.pi / 18, FOLDED.t_end) for k in range(36)])
    assert np.abs(ends - ends[0]).max() < 1e-9 * np.abs(ends[0]).max()
