"""Tables on terminals and in pipes: no name is broken, nothing is cropped, what has no room is named."""

import io

import awkward
import pytest
from click.testing import CliRunner
from rich.console import Console

import tcbench
from tcbench.cli import main
from tcbench.commands import terminal

NAMES = ["midpoint_temperature", "tc_gauss_adaptive[k=3]"]
HEADS = ["integrator", "scenario", *(f"a_column_{i}" for i in range(9)), "what happened"]
ROWS = [
    [name, "relative_equilibrium", *["-1.234e-05"] * 9, "a sentence that may be folded, word by word"] for name in NAMES
]


def printed(monkeypatch, width):
    screen = Console(width=width, file=io.StringIO(), highlight=False, emoji=False, markup=False)
    monkeypatch.setattr(terminal, "console", lambda: screen)
    screen.print(terminal.make_table("", HEADS, ROWS))
    return screen.file.getvalue()


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_no_name_and_no_number_is_broken_and_what_has_no_room_is_named(monkeypatch, width):
    lines = printed(monkeypatch, width).splitlines()
    rows = [line for line in lines if line.startswith(tuple(NAMES))]
    assert len(rows) == 2 and max(map(len, lines)) <= width
    for row in rows:
        assert "relative_equilibrium" in row and set(row.split()[2:]) <= {"-1.234e-05", *ROWS[0][-1].split()}
    shown = next(line for line in lines if line.startswith("integrator")).split()
    left_out = [head for head in HEADS if head.split()[0] not in shown]
    text = " ".join(" ".join(lines).split())
    assert all(head in text.partition(terminal.TOO_NARROW)[2] for head in left_out)


def test_a_pipe_has_every_column_on_one_line(capsys):
    terminal.put(terminal.make_table("", HEADS, ROWS * 40))
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith(tuple(NAMES))]
    assert len(lines) == 80 and all(line.endswith(ROWS[0][-1]) for line in lines)


def test_a_table_is_written_for_a_paper(tmp_path):
    """Heads are words, small numbers are powers of ten and not 0.000000, names print as they are."""
    run = awkward.write_run(tmp_path / "run", {"conservation": awkward.conservation(["tc_monolithic", "a&b_%"])})
    words = ["show", str(run), "--table", "conservation", "--latex", "-s", "short_term"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    head, first = done.output.splitlines()[2], done.output.splitlines()[4]
    assert head.startswith("scenario & integrator & step size h & status & max $|$E $-$ E$_0$$|$ / V$_0$")
    assert first.startswith(r"short\_term & tc\_monolithic & 0.075 & ok & $10^{-15}$")
    assert r"a\&b\_\%" in done.output and "0.000000" not in done.output and done.output.count("\\\\\n") == 11
    alone = CliRunner().invoke(main, ["show", str(run), "--latex"])
    assert alone.exit_code == 2 and "--table NAME" in alone.output


@pytest.mark.usefixtures("here")
def test_a_map_says_its_step_and_takes_another(tmp_path):
    words = ["map", "tc_monolithic", "short_term", "--x", "stiffness=1:2:2", "--y", "temperatures=1:1.1:2", "-q"]
    done = CliRunner().invoke(main, [*words, "--dt", "0.2", "-o", str(tmp_path / "map")])
    assert done.exit_code == 0, done.output
    table = tcbench.load(tmp_path / "map").tables["map"]
    assert set(table["dt"]) == {0.2}
    titles = [ax.get_title(loc="left") for ax in tcbench.draw("map", {"map": table}).axes]
    assert titles == ["tc_monolithic, h = 0.2"]
    twice = CliRunner().invoke(
        main, ["map", "tc_monolithic", "short_term", "--x", "dt=1:2:2", *words[5:], "--dt", "0.2"]
    )
    assert twice.exit_code == 2 and "The step is an axis of this map already" in twice.output


def test_the_conservation_table_has_every_invariant_and_metric_and_no_empty_column(tmp_path):
    table = awkward.conservation(["tc_monolithic"], ["short_term"])
    table = table.assign(angular_momentum_error_max=float("nan"), casimir_error_max=1e-15, hottest=1.5)
    run = awkward.write_run(tmp_path / "run", {"conservation": table})
    head = CliRunner().invoke(main, ["show", str(run), "--table", "conservation"]).output.splitlines()[2]
    assert "casimir_error_max" in head and "hottest" in head and "|dJ|/J" not in head
