"""The paper's figures 2 to 9: one file each, and captions whose numbers agree with the ledger of claims."""

import re

import pytest

from tcbench.errors import TcbenchError
from tcbench.report.paper_figures import FIGURES, paper_figures


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    paper_figures(folder / "new", ".svg")
    return folder / "new"


def test_each_figure_is_one_file_with_its_caption(folder):
    captions = (folder / "captions.md").read_text("utf-8")
    assert [f.number for f in FIGURES] == list(range(2, 10))
    for figure in FIGURES:
        text = (folder / f"figure_{figure.number}.svg").read_text("utf-8")
        assert f"Romero (2009), figure {figure.number}" in text and "temperatures" in text
        assert f"**figure_{figure.number}.svg.** Romero (2009), figure {figure.number}" in captions


def test_captions_agree_with_what_is_known_of_the_printed_data(folder):
    captions = dict(re.findall(r"\*\*figure_(\d)\.svg\.\*\* (.*)", (folder / "captions.md").read_text("utf-8")))
    assert "S from 1.244 to 1.2955, never falling" in captions["2"]
    assert "E from 421.64 to 424.1" in captions["5"] and "ends at t = 25.2" in captions["5"]
    assert "8.539 and 9.333" in captions["9"] and "2.8034" in captions["9"] and "not reached" in captions["9"]


def test_figures_are_the_same_when_drawn_again(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("tcbench.report.paper_figures.FIGURES", FIGURES[:1])
    paper_figures(tmp_path, ".svg")
    assert (tmp_path / "figure_2.svg").read_bytes() == (folder / "figure_2.svg").read_bytes()


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(TcbenchError, match=r"\.png"):
        paper_figures(tmp_path, ".gif")
