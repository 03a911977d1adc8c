"""How a run ends badly: four marks, the same in every table, sentence, cell and chart."""

from __future__ import annotations

from typing import Any

MARKS = {"B": "blow-up", "S": "entropy falls", "R": "no root", "P": "not positive", "x": "no answer"}
OF_STATUS = {
    "ok": "", "blowup": "B", "nonfinite": "B", "nonconverged": "R", "no_root": "R", "unphysical": "P",
}  # fmt: skip
WORDS = {"entropy": "S", "temperature": "P", "positive": "P", "collapsed": "P"}  # of a cause -> mark


def mark_of(status: Any, fell: bool = False) -> str:
    """Of a run: "" where it ended and its entropy never fell; "x" where the program ended it, not the method."""
    return OF_STATUS.get(str(status), "x") or ("S" if fell else "")


def mark_of_limit(limit: Any, cause: Any) -> str:
    """Of a largest stable step: ">" where no limit was found, "" where none was sought.

    cause : the sentence of the first run that failed; a limit that is physical is told apart by it.
    """
    kinds = {"none": ">", "solver": "R", "branch": "R", "positivity": "P"}
    if not isinstance(limit, str):
        return ""
    return kinds.get(limit) or next((mark for word, mark in WORDS.items() if word in str(cause)), "B")


def as_text(counts: dict[str, int]) -> str:
    """ "3 blow-up, 2 entropy falls"."""
    return ", ".join(f"{counts[mark]} {text}" for mark, text in MARKS.items() if counts.get(mark))
