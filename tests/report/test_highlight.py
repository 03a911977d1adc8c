"""Who is in colour where many methods ran: the best of each family, in every picture and on the page the same."""

import awkward
import pytest

import tcbench
from tcbench.report.charts.style import OTHER
from tcbench.report.highlight import CROWD, leaders
from tcbench.report.plot import run_looks

MANY = [*awkward.FIVE, *awkward.PEERS, *(f"a_method_of_ours_{i:02d}" for i in range(9))]
TABLES = awkward.everything(MANY, ["short_term", "stiff_spring"])
DECLARED = awkward.declared(MANY, ["short_term", "stiff_spring"])


def by_hand(scenario):
    """Of each family the one that is first at the smallest of 1e-9, 1e-6, 1e-3 that any of it reaches."""
    table, told = TABLES["time_to_accuracy"], DECLARED["integrators"]
    rows = table[table["scenario"].eq(scenario) & table["measure"].eq("error") & table["time_s"].notna()]
    rows = rows.assign(family=rows["integrator"].map(lambda name: told[name]["family"]))
    firsts = rows.sort_values(["target", "time_s"]).groupby("family")
    each = -(-5 // rows["family"].nunique())
    return {name for _, part in firsts for name in list(dict.fromkeys(part["integrator"]))[:each]}


@pytest.mark.parametrize("scenario", ["short_term", "stiff_spring"])
def test_the_best_of_each_family_lead(scenario):
    found = leaders(TABLES, DECLARED)[scenario]
    assert by_hand(scenario) <= set(found) and len(found) < len(MANY)


def test_a_few_methods_are_all_in_colour():
    few = awkward.everything(MANY[:CROWD], ["short_term"])
    assert leaders(few, {})["short_term"] == sorted(MANY[:CROWD])


@pytest.mark.parametrize("kind", ["work-precision", "conservation", "laws"])
def test_a_picture_draws_those_in_their_colour_and_the_rest_in_grey(kind, tmp_path):
    folder = awkward.write_run(tmp_path / "run", TABLES, (), DECLARED)
    figure = tcbench.draw(kind, folder, scenario="short_term")
    front, looks = leaders(TABLES, DECLARED)["short_term"], run_looks(TABLES)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    shown = [name for name in front if name in texts]
    assert shown and len(texts) - len(shown) <= 2 and any(text.endswith(" others") for text in texts)
    colours = {line.get_color() for line in figure.axes[0].lines if len(line.get_xdata()) > 1}
    assert colours == {looks[name].colour for name in shown} | {OTHER.colour}
    named = tcbench.draw(kind, folder, scenario="short_term", methods=MANY)  # who is asked for is in colour
    assert OTHER.colour not in {line.get_color() for line in named.axes[0].lines}


def test_a_method_looks_the_same_in_every_chart_of_a_run():
    looks = run_looks(TABLES)
    assert len({(one.colour, one.marker) for one in looks.values()}) == len(looks)
    for kind, methods in (("conservation", MANY[3:9]), ("convergence", MANY[8:12])):
        figure = tcbench.draw(kind, TABLES, scenario="short_term", methods=methods)
        drawn = {h.get_label(): (h.get_color(), h.get_marker()) for h in figure.legends[0].legend_handles}
        assert {n: drawn[n] for n in methods} == {n: (looks[n].colour, looks[n].marker) for n in methods}
