"""One line of `tcbench check`: what was asked, the verdict, what was found, and the remedy."""

from __future__ import annotations

from dataclasses import dataclass

OK, FAIL, NONE = "ok", "FAIL", "-"


@dataclass(frozen=True)
class Line:
    """One line of the contract: verdict "ok", "FAIL" or "-" (does not apply), what was found, and the remedy."""

    check: str
    verdict: str
    found: str = ""
    remedy: str = ""


def line(check: str, good: bool, text: str, remedy: str) -> Line:
    """A line whose remedy is shown only where it is needed."""
    return Line(check, OK, text) if good else Line(check, FAIL, text, remedy)
