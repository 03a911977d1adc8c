"""The summary: claims count where they were measured, every invariant is one, and each name has one meaning."""

from dataclasses import replace

import numpy as np
import pandas
import pytest

import tcbench
from tcbench import Integrator
from tcbench.report.pairs import pairs
from tcbench.report.summary import claims_kept, summary
from tcbench.studies.cost import reach
from tcbench.studies.work_precision import tabulate
from tests.simulation.test_changed_formulas import Springs, springs


class Sliding(Springs):
    """Two free masses joined by a spring and a spring of rest length: both momenta below are kept; none is angular."""

    name = "sliding"
    n_positions, n_elements = 2, 2

    def inertia(self):
        return np.array([self.mass, 2.0 * self.mass])

    def shape(self, q):
        return np.array([1.0 + q[1] - q[0], 2.0 + q[0] - q[1]])

    def invariants(self, q, p):
        return {"px": p[0] + p[1], "centre": 0.0 * q[0] + (p[0] + p[1]) * 3.0}


def sliding(momenta=(0.5, -0.5)):
    return replace(springs(), system=Sliding, name="sliding", positions=(0.0, 0.1), momenta=momenta)


def shove(z, h, system):
    """Explicit Euler with a push: momentum grows by 0.1 h a step."""
    rise = h * np.asarray(system.vector_field(z))
    rise[2] += 0.1 * h
    return z + rise


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    methods = [
        "tc_monolithic",
        Integrator(name="liar", order=1, step=shove, claims={"px", "angular_momentum"}),
    ]  # fmt: skip
    return tcbench.run(methods, [sliding()], ["conservation"], tmp_path_factory.mktemp("run"), dt=[0.1]).tables


def test_every_invariant_has_its_column_its_claim_and_its_chart(tables):
    table = tables["conservation"].set_index("integrator")
    assert table.loc["tc_monolithic", "px_error_max"] < 1e-13 and "angular_momentum_error_max" not in table
    # the sum of the momenta is 0: the departure is over the size of the terms, here |p_0| + |p_1| = 1
    assert table.loc["liar", "px_error_max"] == pytest.approx(0.1 * table.loc["liar", "t_final"], rel=1e-6)
    assert table.loc["liar", "centre_error_max"] == pytest.approx(table.loc["liar", "px_error_max"], rel=1e-6)
    from tcbench.report.charts.ladders import conservation
    from tcbench.report.charts.runs import laws

    for figure in (conservation(tables["conservation"]), laws(tables["series"])):
        words = " ".join(text.get_text() for text in figure.findobj(lambda o: hasattr(o, "get_text")))
        assert "px" in words and "centre" in words


def test_claims_count_where_they_were_measured(tables):
    claims = {"tc_monolithic": tcbench.integrators()["tc_monolithic"].claims, "liar": {"px", "angular_momentum"}}
    methods = {name: {"claims": sorted(of)} for name, of in claims.items()}
    rows = summary(pairs(tables, {}), methods).set_index("integrator")
    assert rows.loc["tc_monolithic", "claims kept"] == "4 of 4"  # momenta are all that a system declares
    assert rows.loc["liar", "claims kept"] == "0 of 2, not centre, px"
    assert rows["claims broken"].to_dict() == {"tc_monolithic": 0, "liar": 2}


def test_a_claim_that_nothing_measures_is_not_kept():
    rows = pandas.DataFrame({"steps": [3], "energy_error_max": [np.nan], "status": "ok"})
    (row,) = pairs({"conservation": rows.assign(integrator="a", scenario="s")}, {}).to_dict("records")
    assert claims_kept(row, ["energy"]) == ("0 of 0, 1 not measured", 0)


def point(error, seconds, **more):
    errors = {f"error_{name}": error for name in ("q", "p", "s", "theta")}
    return {"status": "ok", "error": error, "wall_time_min_s": seconds, "reference_limited": False} | errors | more


@pytest.mark.parametrize(
    "points",
    [
        [point(1e-3, 1e-3), point(1e-5, 2e-3), point(1e-7, 4e-3)],
        [point(1e-3, 1e-3), point(1e-7, 4e-3) | {"error_theta": 2e-6}],
        [point(1e-3, 1e-3), point(np.nan, 4e-3, reference_limited=True)],
    ],
)
def test_the_time_to_an_accuracy_is_one_number_everywhere(points):
    tables = tabulate([{"integrator": "a", "scenario": "s", "peer": "", "points": points, "horizons": []}])
    line = tables["time_to_accuracy"].set_index(["measure", "target"]).loc[("error", 1e-6), "time_s"]
    assert reach(tables["work_precision"].to_dict("records"), "error", 1e-6) == pytest.approx(line, rel=1e-12)
    assert summary(pairs(tables, {}), {})["time to 1e-6"].tolist() == [f"{1e3 * line:.3g} ms"]


def test_one_name_has_one_unit():
    """`summary.energy_error_max` in Python is the column of that name: over the initial exergy."""
    run = tcbench.simulate("midpoint_entropy", "short_term", dt=0.3)
    from tcbench.simulation import metrics

    row, V0 = metrics.conservation(run), run.scenario.initial_exergy
    for name in ("energy_error_max", "energy_drift", "lyapunov_increment_max"):
        assert row[name] == getattr(run.summary, name)
    assert row["energy_error_max"] == np.abs(run.energy - run.energy[0]).max() / V0 and abs(V0 - 1) > 0.1
    slope = np.polyfit(run.t[1:], (run.energy - run.energy[0])[1:], 1)[0] / V0
    assert row["energy_drift"] == pytest.approx(slope, rel=1e-6)
