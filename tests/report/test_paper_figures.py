"""The paper's figures 2 to 9: one file each, and captions whose numbers agree with the ledger of claims."""

import re

import pytest

from tcbench.errors import TcbenchError
from tcbench.report.paper_figures import FIGURES, paper_figures

FIRST = FIGURES[:1]
NUMBERS = {  # in the caption of a figure
    2: ("S from 1.244 to 1.2955, never falling",),
    5: ("E from 421.64 to 424.1", "ends at t = 25.2"),
    9: ("8.539 and 9.333", "2.8034", "not reached"),
}


def drawn(figures, folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tcbench.report.paper_figures.FIGURES", figures)
        paper_figures(folder, ".svg")
    return folder


@pytest.mark.parametrize("figures", [FIRST, pytest.param(FIGURES, marks=pytest.mark.thorough)], ids=["one", "all"])
def test_each_figure_is_one_file_with_its_caption_and_the_same_when_drawn_again(figures, tmp_path):
    folder = drawn(figures, tmp_path / "new")
    text = (folder / "captions.md").read_text("utf-8")
    assert [f.number for f in FIGURES] == list(range(2, 10))
    for figure in figures:
        picture = (folder / f"figure_{figure.number}.svg").read_text("utf-8")
        assert f"Romero (2009), figure {figure.number}" in picture and "temperatures" in picture
        (caption,) = re.findall(rf"\*\*figure_{figure.number}\.svg\.\*\* (Romero .*)", text)
        assert all(words in caption for words in NUMBERS.get(figure.number, ()))
    again = drawn(FIGURES[:1], tmp_path / "again")
    assert (again / "figure_2.svg").read_bytes() == (folder / "figure_2.svg").read_bytes()


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(TcbenchError, match=r"\.png"):
        paper_figures(tmp_path, ".gif")
