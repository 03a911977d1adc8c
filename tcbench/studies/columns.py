"""What the columns of the tables are: their names on charts and terminals, which way is worse.

A column that is not listed is written as it is called.
"""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase
from functools import cache
from typing import Any, NamedTuple

ERROR_MAX = "_error_max"
KEPT = 1e-9  # relative error up to which a conserved quantity counts as kept: round-off and solver, over any horizon


class Column(NamedTuple):
    """One column, or those whose names match a shell pattern.

    label : on the axis of a chart. short : heading on a terminal. unit : of the values; "" is dimensionless.
    worse : "higher", "lower" or "larger" (in magnitude, of errors, which may be signed); "" where no direction is
        better.
    good : words that say that all went well, of a column of words.
    timing : measured with a clock; counts only where a cell ran alone, judged by `store.timings`.
    shown : it says what came out; otherwise it says where a row comes from. compared : differences between runs count.
    """

    name: str
    label: str = ""
    short: str = ""
    worse: str = ""
    unit: str = ""
    good: tuple[str, ...] = ()
    timing: bool = False
    shown: bool = True
    compared: bool = True


def _error(name: str, label: str = "", short: str = "") -> Column:
    return Column(name, label, short, worse="larger")


def _timing(name: str, label: str = "", short: str = "", unit: str = "s") -> Column:
    return Column(name, label, short, worse="higher", unit=unit, timing=True)


def _step(name: str, short: str = "", label: str = "") -> Column:
    return Column(name, label, short, worse="lower")


def _origin(name: str, compared: bool = False) -> Column:
    return Column(name, shown=False, compared=compared)


COLUMNS = (  # the first that fits counts: names before patterns
    # controls
    Column("dt", "step size h"),
    Column("tolerance", short="tol"),
    Column("value", "control (dt or rtol)"),
    Column("t", "time t"),
    # how it ended
    Column("status", good=("ok",)),
    Column("verdict", good=("as declared", "holds")),
    _step("blowup_time", "fails at", "time t at which the run failed"),
    # laws
    _error("energy_error_max", "max |E − E₀| / V₀", "|dE|/V0"),
    _error("energy_error_final", "|E − E₀| / V₀ at the end"),
    _error("angular_momentum_error_max", "max |J − J₀| / |J₀|", "|dJ|/J"),
    Column("entropy_increment_min", "least increment of S in a step", "min dS", worse="lower"),
    Column("entropy_fall_max", "largest fall of S in a step", worse="higher"),
    _error("second_law_violations", "steps on which S fell"),
    Column("lyapunov_increment_max", "largest rise of E − θ_ref S in a step", worse="higher"),
    # errors
    Column("reference_floor", "what errors below ten times this say nothing of", "floor"),
    _error("error", "error of the state"),
    _error("error_q", "error of positions q"),
    _error("error_p", "error of momenta p"),
    _error("error_s", "error of entropies s"),
    _error("error_theta", "error of temperatures θ"),
    _error("error_entropy_produced", "error of the entropy produced"),
    _error("error_path_max", "largest error over the trajectory", "path max"),
    _error("error_path_rms", "root mean square of the error over the trajectory", "path rms"),
    _error("error_end", "error of the state at the end", "end"),
    _error("symplecticity_defect", "|M L Mᵀ − L| of a step without dissipation", "symplecticity"),
    Column("energy_growth_exponent", "a of |E − E₀| ~ tᵃ", "growth", worse="higher"),
    _error("energy_growth_end", "|E − E₀| / V₀ of the last half of a long run", "dE long"),
    _error("rmse_q", "root mean square of the error of q"),
    _error("rmse_p", "root mean square of the error of p"),
    _error("rmse_entropy", "root mean square of the error of S"),
    _error("rmse_energy", "root mean square of E − E₀"),
    _step("order"),
    _step("order_low", "low"),
    Column("order_high", short="high"),
    Column("points_used", short="points"),
    # stability
    _step("dt_stable", "stable", "largest stable step h"),
    Column("dt_unstable", short="unstable"),
    _step("dt_half"),
    _step("dt_fold", "fold"),
    Column("limit_plain", short="plain limit"),
    _step("dt_stable_plain", "stable"),
    Column("dt_unstable_plain", short="unstable"),
    # ensembles
    Column("failed", worse="higher"),
    Column("broken", worse="higher"),
    Column("quantile_99", short="99 %"),
    Column("fails_from", short="fails from"),
    Column("tau", "time over the fastest method's, τ"),
    # equilibrium
    _error("entropy_gap", "entropy: S* − S", "entropy gap"),
    _error("strain_gap", "log strains: max |L − L*|"),
    _error("temperature_gap", "temperatures: max |θ − θ*|"),
    _error("rotation_gap", "rate of rotation: |ω − ω*|"),
    Column("growth_a", short="growth a"),
    Column("growth_b", short="growth b"),
    # work
    Column("steps", "steps"),
    _error("newton_iterations", "Newton iterations"),
    _error("newton_iterations_mean", "Newton iterations per step", "Newton"),
    Column("inner_steps_mean", "steps of the method inside of one", "inner"),
    _error("rhs_evaluations", "right-hand sides evaluated"),
    _error("evaluations", "evaluations of the right-hand side or formula"),
    _error("steps_to", "steps to the accuracy"),
    _error("evaluations_to", "evaluations to the accuracy"),
    _timing("us_per_step", "time per step, µs", "us/step", "us"),
    _timing("wall_time_min_s", "wall time, s (minimum)", "seconds"),
    _timing("wall_time_median_s", "wall time, s (median)"),
    _timing("time_s", "time, s", "seconds"),
    _timing("seconds"),
    Column("ratio_to_best_peer", short="best peer/this", timing=True),
    Column("ratio_to_best_scipy", short="best SciPy/this", timing=True),
    Column("exponent_steps", short="time ~ steps^", timing=True),
    Column("exponent_horizon", short="time ~ horizon^", timing=True),
    Column("exponent_first", short="first ~ size^", timing=True),
    Column("exponent_step", short="step ~ size^", timing=True),
    Column("exponent_memory", short="memory ~ size^", timing=True),
    # size
    Column("numbers", "numbers in a state"),
    Column("us_foreseen", "time per step that is foreseen, µs", "foreseen", unit="us"),
    _timing("first_step_s", "time to the first step, s", "first step"),
    _timing("memory_mb", "memory, MB", "MB", "MB"),
    # sentences, and how often
    Column("repeats", compared=False),
    *(Column(n, compared=False) for n in ("why", "command", "note", "measured", "reason", "reference", "cause")),
    *(Column(n, compared=False) for n in ("left_out", "made")),  # which depends on the time that others take
    # where a row comes from: how, where and when its cell ran
    *(_origin(n, compared=True) for n in ("scenario_hash", "study", "exception_type")),
    *(_origin(n) for n in ("plugin", "tcbench_version", "yardsticks", "yardsticks_again")),
    *(_origin(n) for n in ("inputs", "measured_by", "scenario_fields")),
    *(_origin(n) for n in ("source_hash", "cell_time_s", "shared_runs", "timed", "key", "failure", "metric_failure")),
    *(_origin(n) for n in ("fingerprint", "output_tail", "traceback", "traceback_tail", "exception_message")),
    *(
        _origin(n)
        for n in ("worker_host_cpu", "machine", "shuffle_order", "shuffle_seed", "of_the_machine", "series", "opening")
    ),
    _timing("wall_time_s")._replace(shown=False, compared=False),
    # of plugins, and inside rows
    _step("dt_stable*"),
    _timing("*time*_s"),
    _timing("*_us", unit="us"),
    *(_error(pattern) for pattern in ("*error*", "*drift*", "*violations*", "*iterations*", "*residual*", "*_gap*")),
)


def invariant_columns(names: Iterable[Any]) -> list[str]:
    """Those of the conservation table that say how far an invariant was missed: NAME_error_max."""
    return [n for n in map(str, names) if n.endswith(ERROR_MAX) and n != "energy_error_max"]


def claim_column(claim: str) -> str:
    """The column of the conservation table by which a claim is judged: "energy", "entropy" or an invariant's name."""
    return "second_law_violations" if claim == "entropy" else f"{claim}{ERROR_MAX}"


@cache
def column(name: str) -> Column:
    """What is known of a column; its label and its heading are its name where nothing else is known."""
    found = next((c for c in COLUMNS if fnmatchcase(name, c.name)), Column(name))
    plain = f"error of {name.removeprefix('error_')}" if name.startswith("error_") else name.replace("_", " ")
    return found._replace(name=name, label=found.label or plain, short=found.short or name)


def shown_columns(names: Iterable[Any]) -> list[str]:
    """Those that say what came out, in their order."""
    return [str(name) for name in names if column(str(name)).shown]
