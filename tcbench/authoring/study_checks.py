"""Lines of `tcbench check` for a study and the charts of its plugin, one cell of it; and for a column, one run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..chart import Chart, sheet_of
from ..errors import STATUSES, TcbenchError, blamed
from ..metric import Metric
from ..runner.codec import row_bytes
from ..simulation.run import simulate
from ..studies.conservation import CONSERVATION, KEPT, as_number
from ..study import Cells, Study
from .check_line import FAIL, NONE, OK, Line

if TYPE_CHECKING:
    from pandas import DataFrame

METHOD, SCENARIO = "tc_monolithic", "short_term"  # of the cell
WHY = "as the row of a cell that raised an exception"


@dataclass(eq=False)
class Trial:
    """What the lines so far have come to."""

    study: Study
    charts: Sequence[Chart]
    cells: Cells = field(default_factory=list)
    record: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, DataFrame] = field(default_factory=dict)

    @property
    def cell(self) -> dict[str, Any]:
        """What the row of the first cell is known by."""
        method, scenario, options = self.cells[0]
        return {"integrator": method.name, "scenario": scenario.name, **options}


def plan(trial: Trial) -> Line:
    """It returns cells."""
    chosen = [plugins.find_integrator(METHOD)], [plugins.find_scenario(SCENARIO)]
    trial.cells = trial.study.planned(*chosen, {"dt": None})
    if not trial.cells:
        return Line("plan", NONE, f"no cell of {METHOD} on {SCENARIO}: a run says the rest")
    return Line("plan", OK, f"{len(trial.cells)} cells of {METHOD} on {SCENARIO}")


def measure(trial: Trial) -> Line:
    """The first cell gives a row."""
    try:
        row = trial.study.measured(*trial.cells[0])
    except TcbenchError:
        raise
    except Exception as error:
        remedy = "If that is a result, return it: {'status': 'no_root', 'failure': str(error)}."
        return Line("measure", FAIL, blamed(error), f"Fix what the message says. {remedy}")
    row_bytes(row)  # as a worker writes it
    if row.get("status", "ok") not in STATUSES:
        told = f"status {row['status']!r} is none of {', '.join(STATUSES)}, by which failures are counted"
        return Line("measure", FAIL, told, "Return one of these, and what is your own under another name.")
    trial.record = {**trial.cell, "status": "ok", "failure": "", **row}
    return Line("measure", OK, f"a row of {', '.join(row)}")


def tables(trial: Trial) -> Line:
    """The row gives tables of the declared names."""
    found = trial.study.tabulated([trial.record])
    trial.tables = {**found}
    absent = [name for name in trial.study.table_names if name not in found]
    told = [f"{name}: {', '.join(map(str, table.columns))}" for name, table in found.items()]
    return Line("tables", OK if told else NONE, "; ".join([*told, *(f"no {name!r} of this row" for name in absent)]))


def failed_cells(trial: Trial) -> Line:
    """A failed cell, whose row has nothing of what `measure` returns, is in a table with its reason."""
    record = {**trial.cell, "status": "exception", "failure": WHY}
    trial.tables = trial.study.tabulated([trial.record, record])
    kept = any(table.isin([WHY]).any(axis=None) for table in trial.tables.values())
    if kept:
        return Line("failed cells", OK, "a table says why")
    return Line("failed cells", NONE, "no table says why one failed: keep the columns status and failure")


def charts(trial: Trial) -> Line:
    """Charts of these tables have panels."""
    told = []
    for chart in trial.charts:
        if chart.possible(trial.tables):
            scenario = chart.scenarios(trial.tables)[0]
            drawn = chart.panels(*chart.of(chart.select(trial.tables, scenario)))
            panels = 1 if hasattr(drawn, "savefig") else len(sheet_of(drawn).panels)
            told.append(f"{chart.name}: {panels} panel{'s' * (panels != 1)}")
    return Line("charts", OK, "; ".join(told)) if told else Line("charts", NONE, "none of these tables")


def number(metric: Metric) -> Line:
    """It is a number of a run, under a name that is free."""
    if metric.name in (*CONSERVATION.names, *KEPT):
        raise TcbenchError("the conservation table has a column of this name; rename the metric.")
    found = as_number(metric.compute(simulate(METHOD, SCENARIO, t_end=1.5)))
    return Line("number", OK, f"{found:.6g} of a run of {METHOD} on {SCENARIO}")


TESTS: tuple[tuple[str, Callable[[Trial], Line]], ...] = (
    ("plan", plan), ("measure", measure), ("tables", tables), ("failed cells", failed_cells), ("charts", charts),
)  # fmt: skip
