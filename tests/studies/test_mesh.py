"""mesh: nodes of several meshes against the finest run, and what has none."""

import numpy as np
import pytest

import tcbench
from tcbench.studies import mesh as study

NAMES = [f"ring[n={n}]" for n in (6, 12, 24)]


@pytest.mark.thorough
def test_distances_are_those_of_the_nodes_that_meshes_share(tmp_path):
    options = {"dt": [0.2, 0.1]}
    table = tcbench.run(["tc_monolithic"], NAMES, ["mesh"], output=tmp_path, options=options).tables["mesh"]
    found = table.set_index(["scenario", "dt"])
    assert set(table["status"]) == {"ok"} and set(table["family"]) == {"ring"} and len(table) == 6
    assert list(found["common_nodes"].dropna()) == [6, 6, 12, 12, 24]
    assert np.isnan(found.loc[(NAMES[2], 0.1), "mesh_error"])  # the finest
    ends = {
        n: (lambda run: np.asarray(run.scenario.model.state(run.z[-1]).q))(tcbench.simulate("tc_monolithic", n, dt=0.1))
        for n in (NAMES[1], NAMES[2])
    }
    expected = np.linalg.norm(ends[NAMES[1]] - ends[NAMES[2]][::2], axis=1).max()
    assert found.loc[(NAMES[1], 0.1), "mesh_error"] == pytest.approx(expected, rel=1e-12)
    figure = tcbench.draw("mesh", {"mesh": table})
    assert [len(ax.lines[0].get_xdata()) for ax in figure.axes] == [2, 1]


def test_meshes_without_a_common_node_and_failed_runs_are_told():
    ran = {"integrator": "a", "scenario": "c[n=2]", "family": "c", "dt": 0.1, "status": "ok", "numbers": 4}
    coarse = ran | {"start": [[0.0], [0.4]], "end": [[0.0], [0.5]]}
    fine = ran | {"numbers": 8, "start": [[0.1], [0.5], [1.0]], "end": [[0.1], [0.6], [1.2]]}
    crash = {"integrator": "a", "scenario": "c[n=9]", "dt": 0.1, "status": "timeout", "failure": "too long"}
    table = study.tabulate([crash, fine, coarse])["mesh"]
    assert list(table["numbers"][:2]) == [4, 8] and list(table["status"]) == ["ok", "ok", "timeout"]
    assert "no node stands where" in table["failure"][0] and table["family"][2] == "c"
