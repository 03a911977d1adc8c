"""A run as a table, a picture and in a notebook; observables of one's own."""

import numpy as np
import pytest

import tcbench
from tcbench import Observable, TcbenchError

KINETIC = Observable("kinetic", lambda run: (run.z[:, 4:8] ** 2 / run.scenario.model.inertia()).sum(axis=1) / 2, "J")


@pytest.fixture(scope="module")
def run():
    return tcbench.simulate("midpoint_entropy", "stiff_spring", dt=0.3)


def test_the_frame_has_every_recorded_state_under_the_names_of_the_state(run):
    frame = run.to_frame([KINETIC])
    assert len(frame) == len(run.t) and list(frame.columns[:5]) == ["t", "q0", "q1", "q2", "q3"]
    assert np.array_equal(frame.filter(regex=r"^[qps]\d$").to_numpy(), run.z)
    assert np.array_equal(frame["theta1"], run.temperatures[:, 1])
    assert np.array_equal(frame["angular_momentum"], run.angular_momentum)
    springs = run.scenario.model.element_energy(run.scenario.model.shapes(run.z).T[:, -1], run.z[-1, 8:]).sum()
    assert frame["kinetic"].iloc[-1] + springs == pytest.approx(run.energy[-1], rel=1e-12)


def test_an_observable_cannot_write_to_the_run(run):
    """It could: what it filled was the run from then on."""
    before = run.z.copy()
    for write in (
        lambda r: r.z.fill(7.0),
        lambda r: [v.fill(7.0) for v in r.invariants.values()],
        lambda r: r.t.sort(),
    ):
        with pytest.raises(TcbenchError, match=r"The observable 'spoils': ValueError: .*read-only"):
            run.observe(Observable("spoils", write))
    assert np.array_equal(run.z, before) and run.z.flags.writeable


def test_an_observable_of_the_wrong_shape_is_refused_with_a_sentence(run):
    with pytest.raises(TcbenchError, match=r"'all' gave shape \(\d+, 10\); one number for each"):
        run.observe(Observable("all", lambda r: r.z))


@pytest.mark.parametrize(
    ("name", "compute", "sentence"),
    [
        ("q0", lambda r: r.t, "has a column 'q0'"),  # the positions were the times then
        ("mine", lambda r: r.t * 1j, "'mine' gave complex numbers"),
        ("mine", lambda r: ["a"] * len(r.t), "'mine': ValueError"),
    ],
)
def test_an_observable_that_is_no_column_of_numbers_is_refused(run, name, compute, sentence):
    with pytest.raises(TcbenchError, match=sentence):
        run.to_frame([Observable(name, compute)])


def test_the_picture_has_a_panel_for_each_quantity(run):
    figure = run.plot([KINETIC])
    labels = [ax.get_ylabel() for ax in figure.axes if ax.get_visible()]
    assert labels == ["(E − E₀) / V₀", "entropy S", "temperatures θ", "angular_momentum − initial value", "kinetic (J)"]
    drawn = figure.axes[0].lines[0].get_ydata()
    assert np.abs(drawn).max() > 1 and "blowup" in figure.get_suptitle()


def test_a_notebook_shows_how_the_run_ended_and_what_the_tables_hold(run, tmp_path):
    shown = run._repr_html_()
    assert "blowup" in shown and "<table>" in shown and run.failure.split(":")[0] in shown
    results = tcbench.run(["tc_monolithic"], ["short_term"], ["conservation"], tmp_path / "r", dt=[0.3])
    assert "<td>conservation</td><td>1</td>" in results._repr_html_() and "tc_monolithic" in results._repr_html_()
