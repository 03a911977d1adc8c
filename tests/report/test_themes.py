"""Charts for papers: size, fonts, order and names of the methods, a style file, one's own Axes; markers that differ."""

import awkward
import matplotlib
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from tiers import tiers

import tcbench
from tcbench import TcbenchError
from tcbench.cli import main
from tcbench.report.chart_kinds import kinds
from tcbench.report.charts import theme

NAMES = ["sdirk2", "tc_gauss", "scipy_odeint", "gauss2", "tc_monolithic", "heyoka"]
TABLES = awkward.everything(NAMES, ["short_term"]) | awkward.ensemble(NAMES)


@pytest.fixture(scope="module")
def table():
    return awkward.everything(NAMES, ["short_term"])["conservation"]


def test_a_chart_is_drawn_into_an_axes_with_names_and_order_of_ones_own(table):
    figure = Figure(figsize=(4, 3))
    ax = figure.add_subplot()
    size = tuple(figure.get_size_inches())
    labels = {"tc_monolithic": "TC", "gauss2": "Gauss, k = 2"}
    work = awkward.everything(NAMES, ["short_term"])["work_precision"]
    made = tcbench.draw("work-precision", work, ax, y=["error_q"], methods=labels)
    assert made is figure and tuple(figure.get_size_inches()) == size and len(figure.axes) == 1
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts[:2] == ["TC", "Gauss, k = 2"] and not set(NAMES) & set(texts)
    with pytest.raises(TcbenchError, match="panels, and one Axes was given"):
        tcbench.draw("conservation", table, ax)
    with pytest.raises(TcbenchError, match="ax or size, not both"):
        tcbench.draw("work-precision", work, ax, y="error_q", size="3x2")
    with pytest.raises(TcbenchError, match="'blowup' has no option x; those that it has: none"):
        tcbench.draw("blowup", awkward.everything(NAMES, ["short_term"])["stability_points"], x="dt")
    with pytest.raises(TcbenchError, match="Did you mean 'gauss2'"):
        tcbench.draw("conservation", table, methods=["gauss3"])


def test_size_font_and_style_are_those_asked_for(table, tmp_path):
    sheet = tmp_path / "mine.mplstyle"
    sheet.write_text("lines.linewidth: 3.5\naxes.edgecolor: red\n")
    one = {"kind": "conservation", "data": table, "y": "energy_error_max"}
    figure = tcbench.draw(**one, size=(9.0, 4.0), font_size=12, style=sheet)
    plain = tcbench.draw(**one)
    assert tuple(figure.get_size_inches()) == pytest.approx((9.0, 4.0))
    ax, before = figure.axes[0], plain.axes[0]
    assert ax.xaxis.label.get_size() == 12 and before.xaxis.label.get_size() == 9
    assert ax.spines["left"].get_edgecolor()[0] == 1.0 and before.spines["left"].get_edgecolor()[0] != 1.0
    sheet.write_text("font.size: 6\naxes.labelsize: 20\n")
    assert tcbench.draw(**one, style=sheet).axes[0].xaxis.label.get_size() == 20
    assert tcbench.draw(**one, style=sheet, font_size=7).axes[0].xaxis.label.get_size() == 7
    for message, options in {
        "are too few for the panels": {"size": "1x1"}, "is no size": {"size": (3, 2, 1)}, "sets nothing": {"style": {}},
        "no matplotlib style": {"style": {"font.sze": 3}}, "between 3 and 40": {"font_size": 0.1},
    }.items():  # fmt: skip
        with pytest.raises(TcbenchError, match=message):
            tcbench.draw(**one, **options)


KINDS_OF_TEST = {name: kind for name, kind in kinds().items() if set(kind.needs) <= set(TABLES)}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS_OF_TEST)
def test_no_type_is_larger_or_smaller_than_what_was_asked_for_implies(kind):
    """Every text of a chart, line and marker follows the size of type: twice the points, twice every size."""
    small, large = (tcbench.draw(kind, TABLES, font_size=points) for points in (5.0, 10.0))
    sizes = [{text.get_fontsize() for text in figure.findobj(Text)} for figure in (small, large)]
    assert sizes[1] == {2 * size for size in sizes[0]} and max(sizes[1]) <= 12
    for size in (Line2D.get_linewidth, Line2D.get_markersize):
        drawn = [[size(line) for ax in figure.axes for line in ax.lines] for figure in (small, large)]
        assert drawn[1] == pytest.approx([2 * value for value in drawn[0]])


FIRST = ("stable-step",)  # each is drawn at up to five sizes of type


@pytest.mark.parametrize("kind", tiers(KINDS_OF_TEST, FIRST))
def test_every_kind_of_chart_fits_the_column_of_a_journal(kind):
    figure = tcbench.draw(kind, TABLES, size="8.5x6cm")
    figure.canvas.draw()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert (width, height) == pytest.approx((8.5 / 2.54, 6 / 2.54))
    assert min(box.x0, box.y0, width - box.x1, height - box.y1) >= -0.05
    assert min(text.get_fontsize() for ax in figure.axes for text in [ax.xaxis.label, ax.yaxis.label]) >= 4


@pytest.mark.thorough
def test_the_users_own_settings_of_matplotlib_count(table):
    one = {"kind": "conservation", "data": table, "y": "energy_error_max"}
    with matplotlib.rc_context({"axes.grid": False, "font.size": 12.0, "axes.labelcolor": "red"}):
        ax = tcbench.draw(**one).axes[0]
    assert ax.xaxis.label.get_color() == "red" and ax.xaxis.label.get_fontsize() == 12.0
    assert tcbench.draw(**one).axes[0].xaxis.label.get_color() == theme.INK
    lines = tcbench.draw(**one, style="grayscale").axes[0].lines
    assert lines[0].get_color() == "0.00"
    dark = tcbench.draw(**one, style="dark_background")
    assert dark.legends[0].get_texts()[0].get_color() == "white"
    assert dark.get_facecolor() == (0, 0, 0, 1)


def test_panels_are_chosen_with_y(table):
    labels = [ax.get_ylabel() for ax in tcbench.draw("conservation", table, y="entropy_increment_min").axes]
    assert labels == ["largest fall of S in a step"]
    figure = tcbench.draw("convergence", TABLES, y=["theta", "q"])
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["positions q", "temperatures θ"]
    with pytest.raises(TcbenchError, match="variable of this run is called 'heat'"):
        tcbench.draw("convergence", TABLES, y="heat")
    with pytest.raises(TcbenchError, match="Did you mean 'energy_error_max'"):
        tcbench.draw("conservation", table, y="energy_error")
    own = Figure().add_subplot()
    assert (
        tcbench.draw("law-quantiles", TABLES, own, y="energy") is own.figure and own.get_title(loc="left") == "energy"
    )


@pytest.mark.usefixtures("here")
def test_a_picture_for_a_paper_from_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = ["run", "-i", "tc_monolithic", "-i", "midpoint_entropy", "-s", "stiff_spring", "--study", "conservation"]
    assert CliRunner().invoke(main, [*run, "-q"]).exit_code == 0
    words = ["--size", "12x8cm", "--y", "energy_error_max", "--font-size", "7"]
    words += ["--methods", "midpoint_entropy=Midpoint,tc_monolithic=TC"]
    done = CliRunner().invoke(main, ["plot", "conservation", *words, "-o", "a.svg"])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "a.svg").read_text()
    assert "Midpoint" in text and "midpoint_entropy" not in text and 'width="340.1' in text
    for wrong, message in (
        (["--size", "big"], "write WIDTHxHEIGHT"),
        (["--font-size", "99"], "not between 3 and 40"),
        (["--style", "no_such_style"], "neither a file nor a style"),
        (["--methods", "=x"], "write the methods as"),
        (["--methods", "tc_monolithic", "-i", "tc_monolithic"], "not with both"),
    ):
        done = CliRunner().invoke(main, ["plot", "conservation", *wrong, "-o", "b.svg"])
        assert done.exit_code == 2 and message in done.output and not (tmp_path / "b.svg").exists()


@pytest.mark.thorough
def test_titles_of_narrow_panels_are_broken_into_lines_and_not_cut():
    figure = tcbench.draw("laws", TABLES, size=(3.35, 3.6), font_size=7)
    figure.canvas.draw()
    boxes = [
        ax.title.get_window_extent() if ax.get_title() else ax._left_title.get_window_extent() for ax in figure.axes
    ]
    assert any("\n" in ax.get_title(loc="left") for ax in figure.axes)
    for k, box in enumerate(boxes):
        assert box.x1 <= figure.bbox.x1 and not any(box.overlaps(other) for other in boxes[k + 1 :])
        assert not any(box.overlaps(ax.get_window_extent()) for ax in figure.axes)
