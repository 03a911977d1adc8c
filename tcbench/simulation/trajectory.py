"""`Trajectory`: what one run gave, failed runs included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from ..integrator import Integrator
    from ..metric import Observable
    from ..systems.scenario import Scenario

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Summary:
    """Extremes over every completed step, also of steps that were not recorded. Dimensionless.

    energy_error_max : largest |E_k - E_0| / V_0, V_0 being `Scenario.initial_exergy`; energy_drift : least-squares
    slope of (E_k - E_0) / V_0 in time: as in the tables, where these names are columns.
    entropy_increment_min : least S_{k+1} - S_k; second_law_violations : increments below -1e-13 max(1, |S|);
    first_entropy_fall : time of the first increment below -1e-10 (NaN if none).
    lyapunov_increment_max : largest increase of (E - theta_ref S) / V_0 in a step.
    invariant_error_max : largest departure of each invariant, absolute (the columns NAME_error_max are relative).
    residual_max : largest scaled residual of an accepted step (NaN if residuals were not asked for).
    """

    energy_error_max: float
    energy_drift: float
    entropy_increment_min: float
    second_law_violations: int
    first_entropy_fall: float
    lyapunov_increment_max: float
    invariant_error_max: Mapping[str, float]
    residual_max: float

    def __eq__(self, other: object) -> bool:
        """The same numbers, NaN being NaN; what a dataclass would say of NaN depends on the Python."""
        if not isinstance(other, Summary):
            return NotImplemented
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(_same(one[name], other[name]) for name in one)
    return bool(one == other or (one != one and other != other))


@dataclass(frozen=True)
class SolverCounts:
    """What the implicit solver needed, over the whole run; a step has one solve a flow."""

    newton_iterations: int = 0
    retried: int = 0  # solves that needed the second initial guess
    tracked: int = 0  # solves that needed continuation in h
    continuation_tries: int = 0
    arcs: int = 0  # solves that needed pseudo-arclength continuation
    folds: int = 0  # folds that those arcs, and the arcs of an audit, went through
    audited: int = 0  # accepted roots that were compared with the arc's
    wrong_roots: int = 0  # those among them that are not the principal root
    rhs_evaluations: int = 0  # of adaptive solvers that report them
    inner_steps: int = 0  # steps that a method took inside of those asked for, as parts that it can solve; 0: not told
    way: str = ""  # of Newton's linear systems: the unrolled elimination of small ones, or sparse; "" in plain Python
    # "steps" and "newton_iterations" of integrators that solve by themselves and do not tell
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run in z = (q, p, s), or the system's own variables, whatever variables the integrator solves in.

    Everything except the wall time is dimensionless. There are m recorded states (every state unless record_every was
    given) of n numbers each, all of them finite.

    Attributes
    ----------
    integrator, scenario : Integrator, Scenario
        What was run.
    dt : float
        Step; NaN of adaptive solvers.
    t : array, shape (m,)
        Times.
    z : array, shape (m, n)
        States.
    energy, entropy : array, shape (m,)
        E and S, by the system's formulas.
    invariants : mapping of str to array, shape (m,)
        By name, such as "angular_momentum".
    temperatures : array, shape (m, n_temperatures)
        Of each element, or as the system defines.
    status : str
        One of `errors.STATUSES`, "ok" if all is well.
    failure : str
        A sentence with step, time and cause; "" if all is well.
    steps : int
        Completed steps; output times of an adaptive solver that does not count its steps.
    newton_iterations : array of int, shape (m - 1,)
        Between consecutive records.
    wall_time_s : float
        Seconds.
    summary : Summary
        Extremes over every step, also of those that were not recorded.
    solver : SolverCounts
        What the implicit solver needed.

    Raises
    ------
    TcbenchError
        By `observe`, `to_frame`, `plot` and `animate`, for observables of another shape and for systems that cannot
        be drawn.

    References
    ----------
    Romero (2009), eqs. (3)-(4) for the two laws, eq. (37) for the Lyapunov functional; docs/measures.md.
    """

    integrator: Integrator
    scenario: Scenario
    dt: float
    t: Floats
    z: Floats
    energy: Floats
    entropy: Floats
    invariants: Mapping[str, Floats]
    temperatures: Floats
    status: str
    failure: str
    steps: int
    newton_iterations: NDArray[np.int64]
    wall_time_s: float
    summary: Summary
    solver: SolverCounts = field(default_factory=SolverCounts)

    @property
    def ok(self) -> bool:
        """Whether the run reached its final time."""
        return self.status == "ok"

    @property
    def angular_momentum(self) -> Floats:
        """J (m,); NaN for a system without it."""
        return self.invariants.get("angular_momentum", np.full(len(self.t), np.nan))

    @property
    def multipliers(self) -> dict[str, Floats]:
        """Multipliers of constraints at each recorded state, by name, (m, count): those that keep the rates 0."""
        from ..systems.multipliers import multipliers  # of few systems

        if (solved := multipliers(self.scenario.model)) is None:
            return {}
        values = np.array([solved.values(z) for z in self.z])
        return {name: values[:, np.array(solved.names) == name] for name in self.scenario.model.multipliers}

    @property
    def constraints_dependent(self) -> str:
        """A sentence where constraints come to depend on each other, as those of a linkage that passes its flat
        position: the motion is not unique there; else ""."""
        from ..systems.multipliers import dependent

        return dependent(self.scenario.model, self.z, self.t, not self.ok)

    @property
    def lyapunov(self) -> Floats:
        """E - theta_ref S (m,), eq. (37)."""
        reference = float(self.scenario.model.reference_temperature)
        return self.energy - reference * self.entropy

    def observe(self, observable: Observable) -> Floats:
        """The observable at each recorded state, shape (m,); TcbenchError where it gives another shape."""
        from .views import observed

        return observed(self, observable)

    def to_frame(self, observables: Sequence[Observable] = ()) -> DataFrame:
        """One row a recorded state: t, variables (m0.., s), energy, entropy, invariants, theta0.., observables."""
        from .views import frame

        return frame(self, observables)

    def plot(self, observables: Sequence[Observable] = ()) -> Figure:
        """Energy error over V0, entropy, temperatures, invariants and the observables against time, one panel each."""
        from .views import picture

        return picture(self, observables)

    def animate(self, *others: Trajectory, path: str | Path | None = None, **options: Any) -> FuncAnimation | Path:
        """The run in motion, beside others of the same scenario; see `tcbench.animate`."""
        import tcbench  # by the public door: pictures stand above runs

        return tcbench.animate([self, *others], path, **options)

    def write(self, path: str | Path, table: str | None = None) -> Path:
        """The states as fields on the mesh, for ParaView: .xdmf, all times in one file and places as displacements; or
        .vtu, a file a state, and a .pvd that lists them, which is returned. Or a picture of the start, the middle and
        the end, filled by temperature: .png, .svg or .pdf. table: the one whose rows are the cells, by default the
        first. TcbenchError where no table has cells of places, or meshio is missing (extra `fem`)."""
        from .fields import write

        return write(self, path, table)

    def _repr_html_(self) -> str:
        from .views import as_html

        return as_html(self)

    def __repr__(self) -> str:
        return (
            f"<Trajectory {self.integrator.name} on {self.scenario.name}: {self.status}, {self.steps} steps"
            f"{'' if np.isnan(self.dt) else f' of {self.dt:g}'}, t = {self.t[-1]:g}>"
        )
