"""Maximum stable step, kinds of limit, blow-up times and maps."""

import math

import numpy as np
import pytest
from scalar import parabola, scalar
from spread import spread
from tiers import tiers

import tcbench
from tcbench.analysis import stable_step as stability
from tcbench.errors import STATUSES, TcbenchError
from tcbench.simulation.run import simulate
from tcbench.studies import map as maps
from tcbench.studies.stability import STABILITY, STUDY

SCENARIOS, INTEGRATORS = tcbench.scenarios(), tcbench.integrators()
SHORT = ["short_term", "stiff_spring", "cold_spring", "fast_conduction"]
TC = [name for name, i in INTEGRATORS.items() if i.kind == "flows" and {"energy", "entropy"} <= i.claims
      and "projected" not in i.tags]  # fmt: skip # from where a large step ends no state near has the laws


def cell(integrator, scenario):
    row = STUDY.measure(INTEGRATORS[integrator], SCENARIOS[scenario], {})
    return {"integrator": integrator, "scenario": scenario, **row}


@pytest.fixture(scope="module")
def midpoint_cells():
    names = ("midpoint_entropy", "midpoint_temperature")
    return {(i, s): cell(i, s) for i in names for s in ("stiff_spring", "cold_spring")}


PAIRS = spread(TC, SHORT, ("tc_monolithic",))


@pytest.mark.parametrize(
    ("integrator", "scenario"), tiers(PAIRS, [pair for pair in PAIRS if pair[0] in ("tc_monolithic", "tc_strang")])
)
def test_a_tc_method_has_no_limit(integrator, scenario):
    """A TC step has a root for every h, and energy and entropy hold: any other verdict is a fault of the tracker."""
    row = cell(integrator, scenario)
    assert row["limit"] == "none" and row["certified"]
    assert row["dt_stable"] == row["dt_cap"] == 4.0 and math.isnan(row["dt_unstable"])
    assert row["limit_plain"] == "solver" and row["dt_stable_plain"] < 4.0
    assert not row["sensitivity"] and "branch" not in {p["kind"] for p in row["points"]}


@pytest.mark.parametrize("t_end, octaves", [(25.0, 2), (1500.0, 1)])
def test_the_fine_ladder_is_shorter_where_runs_are_long(t_end, octaves):
    """Runs fail from 0.3 on: the fine ladder begins one or two octaves below 2^-1.5, the first coarse failure."""

    def evaluate(dt):
        kind = stability.OK if dt < 0.3 else stability.PHYSICAL
        return stability.Outcome(dt, kind, "ok", math.nan, 0.0, 0, 0, "")

    ladder = stability.ladder_of(SCENARIOS["short_term"].replace(t_end=t_end, dt=0.1), evaluate)
    found = stability.boundary(ladder)
    assert stability.step_of(found.stable) < 0.3 <= stability.step_of(found.unstable) and not found.non_monotone
    fine = [rung for rung in ladder.seen if rung % stability.COARSE]
    first_failure = round(64 * math.log2(2**-1.5))
    assert min(fine) == first_failure - octaves * stability.FINE + 1
    assert all(rung in ladder.seen for rung in range(min(fine), found.unstable))
    assert stability.step_of(min(ladder.seen)) == {25.0: 2**-5, 1500.0: 2**-3}[t_end]


def test_kinds_of_limit_of_the_midpoint_rules(midpoint_cells):
    assert {key: row["limit"] for key, row in midpoint_cells.items()} == {
        ("midpoint_entropy", "stiff_spring"): "physical",
        ("midpoint_temperature", "stiff_spring"): "physical",
        ("midpoint_entropy", "cold_spring"): "physical",
        ("midpoint_temperature", "cold_spring"): "branch",
    }
    assert all(row["certified"] for row in midpoint_cells.values())


def test_brackets_are_neighbours_on_the_fine_ladder(midpoint_cells):
    for row in midpoint_cells.values():
        assert row["dt_unstable"] / row["dt_stable"] == pytest.approx(2 ** (1 / 64), rel=1e-12)
        assert row["dt_half"] >= row["dt_unstable"]
        rungs = 64 * np.log2([p["dt"] for p in row["points"]])
        assert rungs == pytest.approx(np.round(rungs), abs=1e-9)
    assert midpoint_cells["midpoint_temperature", "cold_spring"]["dt_fold"] <= 0.32


def test_sensitivity_of_the_blow_up_time(midpoint_cells):
    rows = midpoint_cells["midpoint_entropy", "stiff_spring"]["sensitivity"]
    assert [r["factor"] for r in rows] == [0.5, 1.0, 4.0]
    for r in rows:
        assert r["dt"] == 0.3 and r["runs"] == 41 and r["failed"] == 41
        assert r["earliest"] <= r["median"] <= r["latest"]
    assert rows[0]["median"] <= rows[1]["median"] <= rows[2]["median"] < 5.0


def test_failures_are_sorted_by_whose_fault_they_are():
    outcome, scenario = stability.outcome, SCENARIOS["short_term"]
    assert outcome(INTEGRATORS["tc_monolithic"], scenario, 0.3).kind == "ok"
    assert math.isnan(outcome(INTEGRATORS["tc_monolithic"], scenario, 0.3).blowup_time)
    assert outcome(INTEGRATORS["tc_monolithic"], scenario, 0.63, continuation=False).kind == "solver"
    assert outcome(scalar("parabola", parabola), scenario, 0.6).kind == "branch"
    assert outcome(INTEGRATORS["midpoint_entropy"], SCENARIOS["stiff_spring"], 0.3).kind == "physical"


def failing(name, **how):
    """A run of the given kind of integrator that fails."""
    return simulate(tcbench.Integrator(name=name, order=1, **how), "short_term", dt=0.25)


def heat(z0, z1, h, system):
    """The temperature of spring a falls by 500 in this step, nearly linearly: the root exists and is negative."""
    d = z1.theta - z0.theta
    return np.concatenate([z1.q - z0.q, z1.p - z0.p, [d[0] + 1e-6 * d[0] ** 2 + 2000 * h, d[1]]])


def collapse(z, h, system):
    return np.concatenate([z.q * 0.0, z.p, z.s])


def test_every_status_that_a_run_can_produce():
    produced = {
        simulate("tc_monolithic", "short_term").status,
        simulate("tc_monolithic", "short_term", dt=2.5, continuation=False).status,
        simulate("midpoint_temperature", "cold_spring", dt=2 ** (-107 / 64)).status,
        simulate("midpoint_entropy", "stiff_spring").status,
        failing("cold", flows=heat, variables="temperature").status,
        failing("collapse", step=collapse).status,
        failing("nan", step=lambda z, h, system: z * np.nan).status,
        failing("error", step=lambda z, h, system: 1 / 0).status,
    }
    assert produced == set(STATUSES) - {"crash", "timeout", "skipped"}  # those three are the engine's
    assert failing("cold", flows=heat, variables="temperature").status == "unphysical"
    assert "principal root" in failing("cold", flows=heat, variables="temperature").failure


def test_tables_of_the_study(midpoint_cells):
    lost = {"integrator": "tc_strang", "scenario": "short_term", "status": "timeout", "failure": "120 s"}
    tables = STUDY.tabulate([*midpoint_cells.values(), lost])
    assert set(tables) == set(STUDY.table_names)
    assert (
        list(tables["stability"].columns[: len(STABILITY.names)]) == STABILITY.names and len(tables["stability"]) == 5
    )
    assert set(tables["stability_points"]["solver"]) == {"continuation", "plain"}
    assert len(tables["blowup_sensitivity"]) == 12
    planned = STUDY.plan(list(INTEGRATORS.values()), list(SCENARIOS.values()), {})
    assert len(planned) == len(SCENARIOS) * sum(i.kind != "adaptive" for i in INTEGRATORS.values())


@pytest.mark.parametrize(
    "text", ["dt", "dt=1:2", "dt=2:1:5", "dt=0:1:5", "dt=1:2:1", "dt=a:b:3", "dt=1:2:3:lin", "=1:2:3", "dt=1:inf:3"]
)
def test_a_malformed_axis_is_explained(text):
    with pytest.raises(TcbenchError, match="Axis"):
        maps.parse_axis(text)


def test_axes_and_what_they_vary():
    axis = maps.parse_axis("dt=0.02:4:40:log")
    assert axis.name == "dt" and axis.log and len(axis.values) == 40
    assert axis.values[0] == pytest.approx(0.02) and axis.values[-1] == pytest.approx(4.0)
    scenario = SCENARIOS["short_term"]
    assert maps.varied(scenario, "dt", 0.5) == (scenario, 0.5)
    assert maps.varied(scenario, "stiffness", 10.0)[0].constants["stiffness"] == [1.0, 10.0]
    assert maps.varied(scenario, "stiffness[1]", 300.0)[0].hash == SCENARIOS["stiff_spring"].hash
    assert maps.varied(scenario, "conductivity", 10.0)[0].hash == SCENARIOS["fast_conduction"].hash
    faster = maps.varied(scenario, "energy", 4.0)[0]
    assert faster.momenta == (0.0, 4.0, 2.0, 0.0) and faster.positions == scenario.positions
    with pytest.raises(TcbenchError, match="stiffness"):
        maps.varied(scenario, "stifness", 2.0)
    with pytest.raises(TcbenchError, match="2 entries"):
        maps.varied(scenario, "stiffness[2]", 2.0)
    with pytest.raises(TcbenchError, match="differ"):
        maps.plan([INTEGRATORS["tc_strang"]], [scenario], {"x": "dt=1:2:2", "y": "dt=1:2:3"})


def test_a_map_of_a_general_system_varies_its_own_variables():
    body = SCENARIOS["rigid_body"]
    assert np.allclose(maps.varied(body, "m[1]", 2.0)[0].initial["m"], (0.6, 1.8, 0.5))
    assert maps.varied(body, "damping", 2.0)[0].constants["damping"] == 0.4
    for name in ("momenta", "energy", "mass"):  # it has no momenta, so none is offered
        with pytest.raises(TcbenchError, match="parameter of this map") as refused:
            maps.varied(body, name, 2.0)
        assert "damping" in str(refused.value) and "temperatures" not in str(refused.value)


@pytest.fixture(scope="module")
def small_map():
    names = ("tc_monolithic", "midpoint_entropy")
    options = {"x": "dt=0.1:40:7:log", "y": "stiffness[1]=1:300:4:log"}
    cells = maps.plan([INTEGRATORS[n] for n in names], [SCENARIOS["short_term"]], options)
    records = [{"integrator": i.name, "scenario": s.name, **o, **maps.measure(i, s, o)} for i, s, o in cells]
    return maps.tabulate(records)["map"]


def test_a_map_has_one_row_a_cell(small_map):
    assert len(small_map) == 2 * 7 * 4 and list(small_map.columns) == maps.MAP.names
    ran = small_map[small_map.outcome != "skipped"]
    assert set(small_map[small_map.outcome == "skipped"].dt) == {40.0}  # longer than the horizon
    assert set(ran[ran.integrator == "tc_monolithic"].outcome) == {"ok"}
    assert "physical" in set(ran[ran.integrator == "midpoint_entropy"].outcome)
    assert "solver" in set(ran.outcome_plain) and ran.folds.any()
