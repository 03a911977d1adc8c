"""Tables on terminals and in pipes: no name is broken, nothing is cropped, what has no room is named."""

import io

import pytest
from rich.console import Console

from tcbench import terminal

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
