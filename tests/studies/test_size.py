"""size: what a cell measures on systems that grow, and how rows become exponents and a chart."""

import math

import numpy as np
import pytest

import tcbench
from tcbench.cache import folder
from tcbench.runner.plan import plan_job
from tcbench.studies import size as study

pytestmark = pytest.mark.usefixtures("cells_here")
NAMES = ["chain[n=6]", "chain[n=20]"]


@pytest.fixture(scope="module")
def tables(tmp_path_factory, cells_here):
    return tcbench.run(["tc_monolithic"], NAMES, ["size"], output=tmp_path_factory.mktemp("size")).tables


def test_a_row_has_times_memory_and_laws_of_its_size(tables):
    table = tables["size"].set_index("scenario")
    assert set(table["status"]) == {"ok"} and list(table.loc[NAMES, "numbers"]) == [30, 100]
    assert set(table["family"]) == {"chain"} and set(table["dt"]) == {0.1}
    assert (table["first_step_s"] > 0).all() and (table["us_per_step"] > 0).all() and (table["memory_mb"] >= 0).all()
    assert (table["first_step_s"] > 1e-6 * table["us_per_step"]).all()  # it traces and compiles
    assert table["steps"].max() == study.MOST and table["energy_error_max"].max() < 1e-12
    assert (table["angular_momentum_error_max"] < 1e-12).all()
    assert table["entropy_increment_min"].min() > -1e-13
    assert 0 < table.loc[NAMES[0], "us_foreseen"] < table.loc[NAMES[1], "us_foreseen"]
    direct = tcbench.simulate("tc_monolithic", NAMES[1], t_end=100.0)
    assert direct.summary.energy_error_max == table.loc[NAMES[1], "energy_error_max"]


def test_exponents_are_fitted_a_family(tables):
    fits = tables["size_exponents"].set_index("family")
    assert list(fits.loc["chain", ["smallest", "largest"]]) == [30, 100]
    assert math.isnan(fits.loc["chain", "exponent_step"])  # of two sizes
    rows = [
        {"integrator": "a", "scenario": f"c[n={n}]", "family": "c", "dt": 0.1, "numbers": n, "status": "ok",
         "first_step_s": 0.1 * n, "us_per_step": 30.0 * n**1.5, "memory_mb": 7.0}
        for n in (10, 100, 1000)
    ]  # fmt: skip
    crash = {"integrator": "a", "scenario": "c[n=9]", "dt": 0.1, "status": "timeout", "failure": "too long"}
    made = study.tabulate([*reversed(rows), crash])
    fit = made["size_exponents"].iloc[0]
    assert np.allclose([fit["exponent_first"], fit["exponent_step"], fit["exponent_memory"]], [1.0, 1.5, 0.0])
    assert list(made["size"]["numbers"][:3]) == [10, 100, 1000] and list(made["size"]["family"]) == ["c"] * 4


@pytest.mark.thorough  # plans systems of ten thousand numbers
def test_where_no_scenario_is_named_it_has_its_own_and_each_cell_has_a_process():
    job = plan_job(["tc_monolithic", "scipy_odeint"], None, ["size"])
    assert {cell.scenario for cell in job.cells} == set(study.SCENARIOS) and all(cell.timed for cell in job.cells)
    assert {cell.integrator for cell in job.cells} == {"tc_monolithic"} and job.context["fresh"] == ["size"]
    assert "size" not in {cell.study for cell in plan_job(["tc_monolithic"], ["short_term"]).cells}


def test_kernels_are_compiled_anew_and_the_cache_is_as_before(monkeypatch, tmp_path):
    monkeypatch.setenv("TCBENCH_CACHE_DIR", str(tmp_path))
    before = folder("code")
    with study.no_kernels():
        assert folder("code") != before and not list(folder("code").iterdir())
    assert folder("code") == before == tmp_path / "code"
