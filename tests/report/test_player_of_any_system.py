"""The player draws what a system says of itself in points(); its variables run below."""

import numpy as np
import pandas
import pytest

import tcbench
from tcbench.plugins import find_scenario
from tcbench.report.write_report import write_report
from tcbench.simulation.series import columns, variables
from tcbench.systems.plane import drawn, joints

PAINTED = "() => [...document.querySelector('canvas').getContext('2d').getImageData(0, 0, 640, 460).data].some(v => v)"
MOST_COLOURED = """() => {
  const data = document.querySelector('canvas').getContext('2d').getImageData(0, 0, 640, 460).data;
  let most = -1;  // nothing is painted
  for (let i = 0; i < data.length; i += 4)
    if (data[i + 3] > 200) most = Math.max(most, Math.max(...data.slice(i, i + 3)) - Math.min(...data.slice(i, i + 3)));
  return most;
}"""
JOINTS = {
    "viscous_pendulum": [[0, 1], [1, 2]], "rubbing_piston": [[0, 1], [2, 1]], "heavy_top": [[0, 1]],
    "gas_containers": [[0, 1], [2, 1]], "short_term": [], "chain[n=3]": [[0, 1], [1, 2], [2, 3]],
    "net[nx=9,ny=9]": [],
}  # fmt: skip


@pytest.mark.parametrize("name", JOINTS)
def test_ends_that_are_always_one_point_are_one_joint(name):
    scenario = find_scenario(name)
    assert joints(scenario.model, scenario.z0)[0] == JOINTS[name]


def test_places_are_columns_and_no_variables():
    run = tcbench.simulate("tc_strang", "viscous_pendulum", t_end=3)
    told = columns(run, slice(0, 5))
    assert np.array_equal(told["at_x_2"], run.z[:5, 2]) and np.array_equal(told["at_y_1"], run.z[:5, 1])
    assert not any(name.startswith("at_") for name in variables(told))


def test_a_picture_that_fails_costs_no_run():
    class Own(tcbench.System):
        name = "own"
        variables = {"q": ()}
        energy = entropy = lambda self, z: z.q

        def points(self, z):
            return [[(0, 0), (1 / 0, z.q)]]

    scenario = tcbench.Scenario("own", Own, {}, initial={"q": 1}, t_end=1, dt=0.1)
    assert joints(scenario.model, scenario.z0) == ([], []) and drawn(scenario.model, scenario.z0, np.ones((3, 1))) == {}


@pytest.fixture(scope="module")
def page_of_one(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own") / "run"
    scenario = tcbench.scenarios()["viscous_pendulum"].replace(t_end=6.0)
    tcbench.run(["tc_strang"], [scenario], ["conservation"], folder, dt=[0.3], jobs=1)
    assert "at_x_2" in pandas.read_parquet(folder / "tables" / "series.parquet")
    return write_report(folder)


def test_the_page_plays_it(page_of_one, visit):
    page = visit(page_of_one, "#scenario=viscous_pendulum")
    page.wait_for_function(PAINTED)
    assert "the system at the time" in page.locator(".player canvas").get_attribute("aria-label")
    running = page.locator(".running").all_text_contents()
    assert running[0].startswith("E = ") and any(text.startswith("alpha0 = ") for text in running)
    assert not any(text.startswith("at_") for text in running)


class Ring(tcbench.System):
    """Masses on a ring, three of them drawn, and one temperature, of a bath that rubs on all."""

    name = "ring"
    variables = {"q": ("mass",), "p": ("mass",), "s": ()}
    tables = {"pairs": ("spring", 2, "mass")}
    constants = {"mass": ("mass",), "axes": (2, 2)}

    def energy(self, z):
        ends = z.q[self.pairs]
        return (z.p**2 / self.mass).sum() / 2 + ((ends[:, 1] - ends[:, 0]) ** 2).sum() / 2 + np.exp(z.s)

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        return {"p": -dE.p, "s": (dE.p * dE.p).sum() / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s

    def points(self, z):
        return [[(0, 0), (x, y)] for x, y in ((z.s, 1), (1, 1), (1, 0))]


@pytest.fixture(scope="module")
def page_of_a_ring(tmp_path_factory):
    n, folder = 30, tmp_path_factory.mktemp("ring") / "run"
    constants = {"pairs": [[i, (i + 1) % n] for i in range(n)], "mass": np.ones(n), "axes": [[1, 0], [0, 1]]}
    start = {"q": np.cos(np.arange(n)), "p": np.zeros(n), "s": 0.0}
    ring = tcbench.Scenario("ring", Ring, constants, initial=start, t_end=1.0, dt=0.1)
    tcbench.run(["tc_monolithic"], [ring], ["conservation"], folder, dt=[0.1], jobs=1)
    return write_report(folder)


def test_tables_and_long_arrays_are_told(page_of_a_ring, visit):
    """The rows of a table, and of a matrix, were dashes; hundreds of numbers filled the page."""
    facts = visit(page_of_a_ring, "#scenario=ring").locator("dd").all_text_contents()
    assert "((1, 0), (0, 1))" in facts
    assert "30 × 2 values, 0 to 29" in facts and "30 values, all 1" in facts  # sizes and ranges


def test_one_temperature_colours_no_line_of_three(page_of_a_ring, visit):
    """As in `animate`: the first of them had the colour of the bath."""
    page = visit(page_of_a_ring, "#scenario=ring")
    page.locator(".running").first.wait_for()
    assert 0 <= page.evaluate(MOST_COLOURED) < 60  # the greys of lines and text, some of them bluish
    assert "of 62 variables and temperatures" in page.locator(".player").text_content()
