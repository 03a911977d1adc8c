"""Claims: the checkable statements of Romero (2009), each with what was measured and a verdict that follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..integrator import Integrator
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Table
from .frames import spread, table_of

CLAIMS = Table(
    "claims",
    (
        "claim", "section", "expected", "measured", "verdict", "why", "command", "integrator", "scenario", "group",
    ),
    key=("claim", "section", "group"),
    terminal=("claim", "measured", "verdict"),
)  # fmt: skip
THEOREMS = ("operators", "steps")  # checked on random states of one scenario: of these, else of all, the first
PREFERRED = ("short_term", "bound_equilibrium", "long_term")


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a group of claims, and only groups about what is selected; nothing selected, no rows.

    Theorems: the operators once, the steps for every method that claims something of this system. Entries of the
    ledger: those whose integrator and scenario are both selected.
    """
    from .paper_claims import LEDGER

    cells: Cells = []
    by_name = {scenario.name: scenario for scenario in scenarios}
    shared = next((by_name[name] for name in (*PREFERRED, *by_name) if name in by_name), None)
    if shared is not None:
        consistent = [i for i in integrators if {"energy", "entropy"} <= i.claims]
        cells += [(integrator, shared, {"group": "operators"}) for integrator in consistent[:1]]
        shown = {"energy", "entropy", *shared.model.invariant_names}  # what this system can show
        steppers = [i for i in integrators if i.claims & shown and i.kind != "adaptive"]
        cells += [(integrator, shared, {"group": "steps"}) for integrator in steppers]
    for group, entry in LEDGER.items():
        cells += [
            (integrator, scenario, {"group": group})
            for scenario in scenarios
            for integrator in integrators
            if scenario.name in entry.scenarios and integrator.name in entry.integrators
        ]
    return cells


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """The findings of one group."""
    from ..analysis import theorems
    from .paper_claims import LEDGER

    group = options["group"]
    check = getattr(theorems, group) if group in THEOREMS else LEDGER[group].measure
    return {"status": "ok", "findings": [finding.as_dict() for finding in check(integrator, scenario)]}


def tabulate(records: Sequence[Row]) -> Tables:
    """One row a claim. A group that could not be measured keeps one row, with the reason and no verdict."""
    return {"claims": table_of(spread(records, "findings", "failure", failed=not_measured), CLAIMS, by=())}


def not_measured(record: Mapping[str, Any]) -> Row:
    """The row of a cell without findings."""
    what = f"{record['group']}: not measured" if "group" in record else "not measured"
    return {"claim": what, "verdict": "", "why": record.get("failure", "")}


STUDY = Study(
    name="claims",
    place=40,
    description="the paper's statements against measurements: theorems on random states, section 6 in its scenarios",
    tables=(CLAIMS,),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
)
