"""A sweep: many variants of a scenario in one run. Constants are columns, and no course is kept."""

import numpy as np
import pytest

import tcbench
from tcbench.runner.cell import identity_of
from tcbench.studies import conservation

pytestmark = pytest.mark.usefixtures("cells_here")

BASE = tcbench.scenarios()["short_term"].replace(t_end=0.6)


def variants(count):
    return [BASE.replace(name=f"v{k}", coupling=round(0.001 * k, 3), stiffness=(1.0 + k, 2.0)) for k in range(count)]


def test_rows_of_a_sweep_have_the_numbers_of_their_scenarios_and_no_series_and_are_the_same_cells(
    tmp_path, monkeypatch
):
    few = tcbench.run(["tc_monolithic"], variants(1), ["conservation"], dt=[0.3], output=tmp_path)
    assert "series" in few.tables and "coupling" not in few.tables["conservation"]
    monkeypatch.setattr(conservation, "MANY", 2)
    found = tcbench.run(["tc_monolithic"], variants(3), ["conservation"], dt=[0.3], output=tmp_path)
    assert set(found.tables) == {"conservation"} and len(found.every["conservation"]) == 3  # and no row twice
    table = found.tables["conservation"].set_index("scenario")
    assert table.loc["v2", ["coupling", "stiffness0", "stiffness1"]].tolist() == [0.002, 3.0, 2.0]
    assert table.loc["v2", ["positions2", "temperatures1"]].tolist() == [BASE.positions[2], BASE.temperatures[1]]
    assert (table.status == "ok").all() and not {"numbers", "sweep"} & set(table)
    assert np.array_equal(tcbench.load(tmp_path).tables["conservation"].coupling, table.coupling)
    cell = {"study": "conservation", "integrator": "a", "scenario": "b", "options": {"dt": 0.3}}
    assert identity_of(cell) == identity_of({**cell, "options": {"dt": 0.3, "sweep": True}})
    assert identity_of(cell) != identity_of({**cell, "options": {"dt": 0.2}})


def test_a_constant_that_is_called_like_a_measure_does_not_stand_in_its_place():
    row = {"integrator": "a", "scenario": "s", "dt": 0.1, "status": "blowup", "numbers": {"status": 3.0, "k": 2.0}}
    (table,) = conservation.tabulate([row]).values()
    assert list(table["status"]) == ["blowup"] and list(table["k"]) == [2.0]
