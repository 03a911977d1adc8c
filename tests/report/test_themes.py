"""Charts for papers: size, fonts, order and names of the methods, a style file, one's own Axes; markers that differ."""

import awkward
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

import tcbench
from tcbench import TcbenchError
from tcbench.cli import main
from tcbench.report.charts import ladders, style, theme

NAMES = ["sdirk2", "tc_gauss", "scipy_odeint", "gauss2", "tc_monolithic", "heyoka"]


@pytest.fixture(scope="module")
def table():
    return awkward.everything(NAMES, ["short_term"])["conservation"]


def drawn(ax):
    return [line.get_label() for line in ax.get_lines() if not line.get_label().startswith("_")]


def test_methods_of_one_chart_have_markers_of_their_own(table):
    figure = ladders.conservation(table)
    handles = figure.legends[0].legend_handles
    markers = {h.get_label(): h.get_marker() for h in handles if h.get_label() in NAMES}
    assert set(markers) == set(NAMES) and len(set(markers.values())) == len(NAMES)
    assert style.look("tc_monolithic") == style.KNOWN["tc_monolithic"]


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
    with pytest.raises(TcbenchError, match="'conservation' has no option y"):
        tcbench.draw("conservation", table, y=["energy_error_max"])
    with pytest.raises(TcbenchError, match="Did you mean 'gauss2'"):
        tcbench.draw("conservation", table, methods=["gauss3"])


def test_size_font_and_style_are_those_asked_for(table, tmp_path):
    sheet = tmp_path / "mine.mplstyle"
    sheet.write_text("lines.linewidth: 3.5\naxes.edgecolor: red\n")
    chosen = theme.Theme(size=(9.0, 4.0), font_size=12.0, settings=theme.style_settings(sheet))
    with theme.using(chosen):
        figure = ladders.conservation(table)
    plain = ladders.conservation(table)
    assert tuple(figure.get_size_inches()) == pytest.approx((9.0, 4.0))
    ax, before = figure.axes[0], plain.axes[0]
    assert ax.xaxis.label.get_size() == pytest.approx(before.xaxis.label.get_size() * 12 / 9)
    assert ax.spines["left"].get_edgecolor()[0] == 1.0 and before.spines["left"].get_edgecolor()[0] != 1.0
    with theme.using(theme.Theme(size=(1.0, 1.0))), pytest.raises(TcbenchError, match="too few: this chart needs"):
        ladders.conservation(table)


@pytest.mark.parametrize(
    ("text", "found"),
    [("a=A,b", {"a": "A", "b": "b"}), ("g[k=2,x=1]=G,h[k=3]", {"g[k=2,x=1]": "G", "h[k=3]": "h[k=3]"})],
)
def test_methods_are_written_with_their_labels(text, found):
    assert theme.parse_methods(text) == found and list(theme.parse_methods(text)) == list(found)


def test_a_picture_for_a_paper_from_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = ["run", "-i", "tc_monolithic", "-i", "midpoint_entropy", "-s", "stiff_spring", "--study", "conservation"]
    assert CliRunner().invoke(main, [*run, "-q"]).exit_code == 0
    words = ["--size", "12x8cm", "--font-size", "7", "--methods", "midpoint_entropy=Midpoint,tc_monolithic=TC"]
    done = CliRunner().invoke(main, ["plot", "conservation", *words, "-o", "a.svg"])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "a.svg").read_text()
    assert "Midpoint" in text and "midpoint_entropy" not in text and 'width="340.1' in text
    for wrong, message in (
        (["--size", "big"], "write WIDTHxHEIGHT"),
        (["--font-size", "99"], "not between 3 and 40"),
        (["--style", "no_such_style"], "neither a file nor a style"),
        (["--methods", "=x"], "write the methods as"),
    ):
        done = CliRunner().invoke(main, ["plot", "conservation", *wrong, "-o", "b.svg"])
        assert done.exit_code == 2 and message in done.output and not (tmp_path / "b.svg").exists()
    done = CliRunner().invoke(main, ["animate", "tc_monolithic", "stiff_spring", "--t-end", "3", "--frames", "3"])
    assert done.exit_code == 0 and (tmp_path / "movie.gif").stat().st_size > 1000
