"""Both laws hold and temperatures are wrong: a run is told beside the exact motion."""

import numpy as np
import pytest
from mechanics import OfEntropies
from scipy.linalg import expm

import tcbench
from tcbench import Scenario
from tcbench.report.by_method import remarks
from tcbench.simulation import shared_runs
from tcbench.simulation.against_exact import errors_against_exact
from tcbench.studies.conservation import measure


class Rod(OfEntropies):
    """Cells in a row that conduct, the last one large and cold: a wall after a step of temperature, as in
    https://github.com/NREL/EnergyPlus/issues/2872, where a scheme went far below the coldest body."""

    name = "rod"
    variables = {"s": (6,)}
    constants = {"c": (6,), "k": ()}

    def energy(self, z):
        return (self.c * 280.0 * np.exp(z.s / self.c)).sum()

    def irreversible(self, z, dE, dS):
        flow = self.k * (dE.s[:-1] - dE.s[1:])
        return {"s": np.concatenate([-flow[:1], flow[:-1] - flow[1:], flow[-1:]]) / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s


C, START = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 500.0]), np.array([330.0] * 5 + [280.0])
ROD = Scenario("rod", Rod, {"c": C, "k": 1.0}, initial={"s": C * np.log(START / 280)}, t_end=20.0, dt=0.5)


def exact(t):
    K = np.diag([1.0, 2, 2, 2, 2, 1]) - np.eye(6, k=1) - np.eye(6, k=-1)
    return expm(-K / C[:, None] * t) @ START


@pytest.mark.parametrize("h", [0.25, 2.0, 10.0])
@pytest.mark.parametrize("method", ["tc_monolithic", "tc_gauss"])
def test_errors_of_temperatures_and_entropy_are_those_of_the_matrix_exponential(method, h):
    run = tcbench.simulate(method, ROD, dt=h)
    row, theta = errors_against_exact(run), exact(run.t[-1])
    error = np.abs(run.temperatures[-1] - theta).max() / theta.max()
    assert row["t_compared"] == pytest.approx(20.0) and row["error_theta"] == pytest.approx(error, rel=1e-3, abs=1e-8)
    made = C @ np.log(theta / START)
    produced = abs(run.entropy[-1] - run.entropy[0] - made) / made
    assert row["error_entropy_produced"] == pytest.approx(produced, rel=1e-3, abs=1e-8)


def test_a_body_colder_than_the_coldest_is_told_while_both_laws_hold():
    run = tcbench.simulate("tc_monolithic", ROD, dt=20.0)
    row = errors_against_exact(run)
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.second_law_violations == 0
    assert row["theta_min_exact"] == pytest.approx(280.0, abs=1e-6) and row["theta_min"] < 265
    assert row["range_left"] > (280 - row["theta_min"]) / 50  # of the range of its own cell
    fine = errors_against_exact(tcbench.simulate("tc_monolithic", ROD, dt=0.1))
    assert fine["range_left"] < 1e-4 and fine["error_theta"] < 1e-5


def test_tables_have_it_and_a_sentence_says_it():
    import pandas as pd

    method = tcbench.integrators()["tc_monolithic"]
    rows = [
        {"integrator": method.name, "scenario": "rod", "dt": h} | measure(method, ROD, {"dt": h}) for h in (1.0, 20.0)
    ]
    said = [s for s in remarks({"conservation": pd.DataFrame(rows)}) if "left the exact range" in s]
    assert len(said) == 1 and said[0].startswith("1 runs") and "exactly 280 to 330" in said[0]


def test_within_a_run_the_exact_course_is_computed_once(tmp_path, monkeypatch):
    run = tcbench.simulate("tc_monolithic", "short_term", dt=0.3)
    alone = errors_against_exact(run)
    with shared_runs.shared_in(str(tmp_path)):
        assert errors_against_exact(run) == alone
        monkeypatch.setattr("tcbench.simulation.against_exact.path_of", None)  # cannot be called
        assert errors_against_exact(run) == alone and alone["t_compared"] > 1.0
        assert "error_theta" in alone and "range_left" in alone
        damaged = next(tmp_path.glob("*.npz"))
        damaged.write_bytes(damaged.read_bytes()[:300])
        with pytest.raises(TypeError):  # it is computed again
            errors_against_exact(run)
