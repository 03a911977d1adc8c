"""Columns that several tables have, and where to ask what a column is: terminal, charts, page and comparison do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, partial
from itertools import chain
from typing import Any

from ..table import Column, Table

ERROR_MAX = "_error_max"
LAW_TOLERANCE = 1e-9  # relative error up to which a quantity counts as conserved: round-off, over any horizon
_error = partial(Column, worse="larger")
_timing = partial(Column, worse="higher", timing=True)
_origin = partial(Column, shown=False, compared=False)

SHARED = (
    # which run
    *(Column(name, filter=True) for name in ("integrator", "scenario", "variable", "measure", "target", "section")),
    Column("dt", "step size h"),
    Column("tolerance", short="tol"),
    Column("t", "time t"),
    Column("value", "control (dt or rtol)"),
    Column("numbers", "numbers in a state"),
    # how it ended
    Column("status", good=("ok",), filter=True),
    Column("verdict", good=("as declared", "holds"), filter=True),
    Column("blowup_time", "time t at which the run failed", "fails at", worse="lower"),
    Column("failed", worse="higher"),
    # laws and errors
    _error("energy_error_max", "max |E − E₀| / V₀", "|dE|/V0"),
    _error("angular_momentum_error_max", "max |J − J₀| / |J₀|", "|dJ|/J", narrow=6, optional=True),
    Column("entropy_increment_min", "least increment of S in a step", "min dS", worse="lower"),
    _error("error", "error of the state"),
    *(
        _error(f"error_{name}", f"error of {what}", optional=True)
        for name, what in {
            "q": "positions q", "p": "momenta p", "s": "entropies s", "theta": "temperatures θ",
            "entropy_produced": "the entropy produced",
        }.items()
    ),
    Column("reference_floor", "what errors below ten times this say nothing of", "floor"),
    # work
    Column("steps", "steps"),
    _error("newton_iterations_mean", "Newton iterations per step", "Newton", narrow=2),
    Column("inner_steps_mean", "steps of the method inside of one", "inner"),
    _timing("us_per_step", "time per step", "us/step", "µs", narrow=1),
    _timing("time_s", "time", "seconds", "s"),
    Column("repeats", compared=False),
    # sentences
    *(Column(n, compared=False) for n in ("why", "command", "note", "measured", "reason", "reference", "cause")),
    # where a row comes from: how, where and when its cell ran
    *(_origin(n, compared=True) for n in ("scenario_hash", "study", "exception_type")),
    *(_origin(n) for n in ("plugin", "tcbench_version", "wall_time_s")),
    *(_origin(n) for n in ("inputs", "made_by", "uses", "cell_time_s", "shared_runs", "timed", "key", "failure")),
    *(_origin(n) for n in ("metric_failure", "output_tail", "traceback_tail", "exception_message")),
    *(_origin(n) for n in ("worker_host_cpu", "machine", "shuffle_order", "shuffle_seed", "of_the_machine")),
    *(_origin(n) for n in ("series", "opening", "fields")),
)  # fmt: skip


def shared(name: str, **changes: Any) -> Column:
    """A column that several tables have, with what is different in one of them."""
    return replace(next(one for one in SHARED if one.name == name), **changes)


def invariant_columns(names: Iterable[Any]) -> list[str]:
    """Those of the conservation table that say how far an invariant was missed: NAME_error_max."""
    return [n for n in map(str, names) if n.endswith(ERROR_MAX) and n != "energy_error_max"]


def claim_column(claim: str) -> str:
    """The column of the conservation table by which a claim is judged: "energy", "entropy" or an invariant's name."""
    return "second_law_violations" if claim == "entropy" else f"{claim}{ERROR_MAX}"


@cache
def column(name: str, *tables: Table) -> Column:
    """What is known of a column: what the first of the tables says that has it, else what tcbench says of a column of
    this name, else the first pattern of the tables that fits (of all tables where none is given)."""
    exact = (one for table in tables if (one := table.column(name)))
    described = (one for one in own_columns() if one.name == name)
    patterns = (one for table in tables or own_tables() if (one := table.pattern(name)))
    return next(chain(exact, described, patterns), Column(name)).named(name)


@cache
def own_tables() -> tuple[Table, ...]:
    """Those of tcbench's own studies."""
    from .base import own_studies

    return tuple(table for study in own_studies() for table in study.tables)


@cache
def own_columns() -> tuple[Column, ...]:
    """Every column that tcbench describes."""
    return (*SHARED, *(one for table in own_tables() for one in table.columns if isinstance(one, Column)))


def shown_columns(names: Iterable[Any], *tables: Table) -> list[str]:
    """Those that say what came out, in their order."""
    return [str(name) for name in names if column(str(name), *tables).shown]
