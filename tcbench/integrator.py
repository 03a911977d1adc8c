"""`Integrator`: name, order, claims, source, and one of three ways to step; `Flow`: one sub-step of a formula."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NoReturn

from .errors import TcbenchError, expect, shown, unknown_name
from .packages import installed_version

if TYPE_CHECKING:
    from .systems.system import System

SOLVED_FOR = {"entropy": "", "temperature": "temperatures", "energy": "energies"}  # in the place of entropies
TAKE_ANY = "take a method for every system, such as tc_monolithic"
ELEMENTS = f"write its class as an ElementSystem (docs/add-system.md), or {TAKE_ANY}"
WAYS = ("flows", "step", "adaptive")  # to step; an integrator gives one
_NAME = re.compile(r"[a-z][a-z0-9_]*\Z")
Residual = Callable[..., Any]


@dataclass(frozen=True)
class Flow:
    """One sub-step: a residual r(z0, z1, h, system) = 0 that is advanced by `fraction` of the step.

    Parameters
    ----------
    residual : function
        Formula of states z0, z1, shape (n,) each, and the step h, all dimensionless; returns shape (n,). With `stages`
        = k it is r(z0, z1, h, system, stages), stages being k further states, and returns k + 1 blocks, shape (k + 1,
        n).
    fraction : float
        Of the step, dimensionless.
    variables : str
        "entropy": states are (q, p, s), or the system's own variables; "temperature": (q, p, theta); "energy":
        (q, p, u) with the energies u of the elements.
    stages : int
        Further states that are unknowns of the step.
    numbers : tuple of str
        Names of further numbers that are unknowns, dimensionless. Where there are any, the formula's last argument is a
        mapping name -> number, and it returns (rows, equations), one equation a number, whose slope in it is positive.
    chosen : function, optional
        What the formula has to know of a system as a whole: chosen(system), of one with symbols for constants, is
        hashable and the formula's last argument; () of a formula with `most`: there is nothing to mend.
    of_step : bool
        The formula has two more arguments, states (q, p, s): that at the start of the whole step, before its first
        flow, and the first one of the run (of which it may use constants of the motion only: a step has no memory).
    memory : int
        Earlier states that the formula sees; set by the Integrator.
    most : int
        Above 1 the formula ends a step by corrections, with one more argument, moved: z1 is as far from where the step
        ended. What it returns is taken from z1, which begins as z0, once or twice; and so anew from there, where moved
        is 0, `most` times at most, until the state has the energy and the invariants of the run's first state and no
        less entropy than before the step. If it never has, the step fails. The first z0 is where corrections of the
        last steps let this one expect to end, or where the step ended if the formula does not read moved.

    Raises
    ------
    TcbenchError
        For values that are not numbers; when a method that has it runs, for a formula that is not branch-free numpy.

    References
    ----------
    Romero (2009), eq. (6), is such a residual, and eqs. (12)-(13) are two; docs/add-integrator.md.
    """

    residual: Residual
    fraction: float = 1.0
    variables: str = "entropy"
    stages: int = 0
    numbers: tuple[str, ...] = ()
    chosen: Any = None
    of_step: bool = False
    memory: int = 0
    most: int = 1

    def __post_init__(self) -> None:
        expect("A Flow", vars(self), KINDS_OF_FLOWS)
        _check_variables("A Flow", self.variables)
        kinds = {"fraction": float, "stages": int, "memory": int, "most": int}
        try:
            values = {name: kind(getattr(self, name)) for name, kind in kinds.items()}
        except OverflowError:
            values = {"fraction": math.inf}
        if not math.isfinite(values["fraction"]) or min(self.stages, self.memory, self.most - 1) < 0:
            memory = "memory, the number of earlier states, from 0"
            raise TcbenchError(f"A Flow has a finite fraction, stages from 0, most from 1 and {memory}.")
        for name, value in values.items():  # a step times one of float32 had its digits
            object.__setattr__(self, name, value)


KINDS_OF_FLOWS = {"residual": "a function", "fraction": "a number", "of_step": "True or False",
                  **dict.fromkeys(("stages", "memory", "most"), "a whole number")}  # fmt: skip
FUNCTIONS = ("step", "march", "adaptive", "outputs", "workspace", "refuses", "family")
SETS = ("claims", "tags", "systems", "needs", "requires")  # of words
KINDS_OF_FIELDS = {  # of what tcbench reads before it can say more
    **dict.fromkeys((*SETS, "uses"), "words or a word"), **dict.fromkeys(("increments", "by_default"), "True or False"),
    **dict.fromkeys(("source", "description", "nonfinite", "plugin", "base"), "a word"),
    **dict.fromkeys(FUNCTIONS, "a function or nothing"), "parameters": "a mapping",
}  # fmt: skip


@dataclass(frozen=True)
class Integrator:
    """A time integrator and what its author declares about it. Give exactly one of flows, step and adaptive.

    States z have shape (n,); times and steps are in the system's units; everything is dimensionless.

    Parameters
    ----------
    name : str
        Lower-case identifier, unique.
    order : int, optional
        Declared order of convergence; None for an adaptive solver.
    claims : set of str
        What the method conserves or obeys: "energy", "entropy" (never decreases) and any invariant's name.
    source : str
        Paper and equation.
    flows : function, Flow, or sequence of these and of (function, fraction)
        Residual formulas r(z0, z1, h, system). tcbench supplies exact Jacobian, Newton, continuation and failure
        reports.
    step : function
        z1 = step(z, h, system), any Python, shape (n,).
    march : function, optional, beside step
        rows = march(z, h, count, system), shape (up to count, n): the results of the next `count` steps, up to the
        first failure, from a compiled loop of your own.
    adaptive : function
        z = adaptive(system, z0, t_eval, rtol, atol), shape (len(t_eval), n), run at a series of tolerances.
    outputs : function, optional, beside adaptive
        states, counts = outputs(system, z0, t_eval, rtol, atol): an iterator of the rows of `adaptive`, and a dict of
        counts that is kept up to date meanwhile, so that a run that has failed can be stopped.
    increments : bool
        `step` returns z1 - z, which is added with compensated summation: momenta stay exact over thousands of steps.
    memory, starter : int, and str or Integrator
        For a multistep method. With memory=k the formula (a single one, of the whole step) or the step function has one
        more argument, `before`, the k states before z0, all h apart, shape (k, n), the latest first. The first k steps
        are done by the method `starter`, of order at least order - 1.
    workspace : function, optional
        For a step function with work arrays: workspace(system) makes those of one run, the last argument of `step` and
        `march`. The result of `step` must not depend on their contents; `march`, which receives the states of one run
        in order, may rely on what it left there. If it has a method cost(), that returns what the run took:
        {"steps": those of the method itself, "newton_iterations": ...}.
    variables : str
        Of the formulas: "entropy" for z = (q, p, s), "temperature" for (q, p, theta), "energy" for (q, p, u) with the
        energies u of the elements.
    systems : set of str
        Names of the systems that the method is written for; empty for all.
    needs : tuple of str
        Optional functions of `System` that the formulas call, such as "conduction_flow"; the method is left out on
        systems that do not define them.
    elements : bool
        Whether the formulas are written in elements and so need an `ElementSystem`.
    refuses : function, optional
        Any further condition: refuses(system) -> "", or the reason why the method cannot run on the system.
    by_default : bool
        False for a method that runs only where it is named or a pattern matches its name.
    requires : tuple of str
        Packages that the method imports and tcbench does not need, as they are installed ("scikit-sundae"). Without
        them the method is listed as absent.
    tags : set of str
        Free words to filter by.
    description : str
        A sentence for lists.
    nonfinite : str
        The failure of a run that ends with a state that is not finite, for a method that returns one on purpose.
    uses : str or tuple of str
        Methods, or plugins, that this one is made of (for a wrapper, what it wraps): it is not compared with a
        reference of the same kind, and one worker runs their cells. And files that it reads outside its own folder, by
        their path from there: where one has changed, its rows are measured again.
    parameters, family : mapping of str to tuple of str, and function
        A family of methods; see `family`.
    plugin, base : str
        Filled in by the registry: the distribution or file it came from; for a variant, the registered name.

    Raises
    ------
    TcbenchError
        For an invalid name, several or none of flows, step and adaptive, arguments that exclude each other, and a
        fixed-step method without an order.

    References
    ----------
    Romero (2009), eqs. (6)-(13): what makes a method consistent; docs/add-integrator.md.
    """

    name: str
    order: int | None = None
    claims: frozenset[str] = frozenset()
    source: str = ""
    flows: Any = None
    step: Callable[..., Any] | None = None
    march: Callable[..., Any] | None = None
    adaptive: Callable[..., Any] | None = None
    outputs: Callable[..., Any] | None = None
    increments: bool = False
    memory: int = 0
    starter: str | Integrator = ""
    workspace: Callable[[System], Any] | None = None
    variables: str = "entropy"
    systems: frozenset[str] = frozenset()
    needs: tuple[str, ...] = ()
    elements: bool = False
    refuses: Callable[[System], str] | None = None
    by_default: bool = True
    requires: tuple[str, ...] = ()
    tags: frozenset[str] = frozenset()
    description: str = ""
    nonfinite: str = ""
    uses: str | tuple[str, ...] = ()
    parameters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    family: Callable[..., Integrator] | None = None
    plugin: str = ""  # filled in by the registry: distribution or file that brought it
    base: str = ""  # of a variant: the registered name
    _members: dict[Any, Integrator] = field(default_factory=dict, init=False, compare=False, repr=False)

    def __repr__(self) -> str:
        order = "chooses its steps" if self.kind == "adaptive" else f"order {self.order}"
        kept = f", keeps {', '.join(sorted(self.claims))}" if self.claims else ""
        return f"<Integrator {self.name}: {order}{kept}{'; ' if self.source else ''}{self.source}>"

    def __post_init__(self) -> None:
        expect("An Integrator", vars(self), {"name": "a word"})
        expect(f"Integrator {self.name!r}", vars(self), KINDS_OF_FIELDS)
        if not _NAME.match(self.name.partition("[")[0]):
            raise TcbenchError(f"Integrator name {self.name!r} must be lower-case letters, digits and underscores.")
        order: Any = self.order  # whatever an author wrote
        if order is not None and not (isinstance(order, int | float) and order > 0):
            self._refuse(f": order must be a positive number, not {order!r}.")
        for words in SETS:
            if isinstance(getattr(self, words), str):
                self._refuse(f": {words} must be a set of words, such as {{'energy'}}.")
        object.__setattr__(self, "uses", (self.uses,) if isinstance(self.uses, str) else self.uses)
        for name in (*SETS, "uses"):
            kind = tuple if name in ("needs", "requires", "uses") else frozenset
            object.__setattr__(self, name, kind(getattr(self, name)))
        ways = [way for way in WAYS if getattr(self, way) is not None]
        if len(ways) != 1:
            listed = " and ".join(ways) or "none of them"
            self._refuse(f" must give one of flows=, step=, adaptive=; it gives {listed}.")
        own = ": formulas need none, and a call of adaptive= is a run, which makes what it needs"
        for further, way, why in (
            ("march", "step", ", which march= repeats"), ("outputs", "adaptive", ", which outputs= repeats"),
            ("workspace", "step", own),
        ):  # fmt: skip
            if getattr(self, further) is not None and getattr(self, way) is None:
                self._refuse(f" gives {further}= without {way}={why}.")
        _check_variables(f"Integrator {self.name!r}", self.variables)
        if self.flows is not None:
            flows = _as_flows(self.flows, self.variables)
            if any(flow.most > 1 for flow in flows[:-1]) or (flows[-1].most > 1 and not flows[-1].of_step):
                whole = "of the whole step (of_step=True)"
                self._refuse(f": most= is of the last formula alone, {whole}: it is applied until a step has the laws.")
            object.__setattr__(self, "flows", tuple(replace(flow, memory=self.memory) for flow in flows))
        self._check_memory()
        if self.order is None and self.adaptive is None:
            self._refuse(" must declare its order.")

    def _refuse(self, why: str) -> NoReturn:
        raise TcbenchError(f"Integrator {self.name!r}{why}")

    def _check_memory(self) -> None:
        memory: Any = self.memory
        if not isinstance(memory, int) or memory < 0:
            self._refuse(f": memory is a number of earlier states, not {memory!r}.")
        if bool(self.memory) != bool(self.starter):
            self._refuse(
                ": a multistep method gives both memory=, the number of earlier states that its formula sees, and "
                'starter=, the method of its first steps, such as "tc_monolithic".'
            )
        if self.memory and (self.adaptive is not None or self.march is not None):
            self._refuse(": memory= goes with flows= or step= alone; steps must be equal.")
        flows = self.flows if self.memory and self.flows is not None else ()
        if len(flows) > 1 or any(flow.of_step or flow.fraction != 1.0 for flow in flows):
            self._refuse(": with memory= there is one formula, of the whole step.")

    def __getstate__(self) -> dict[str, Any]:
        """What is copied and pickled."""
        return {**vars(self), "_members": {}}

    def held_by_a_run(self, system: System) -> tuple[Any, ...]:
        """What a run holds, for its calls of `step` and `march`: a workspace of its own, if the method has one."""
        return () if self.workspace is None else (self.workspace(system),)

    @property
    def kind(self) -> str:
        """ "flows", "step" or "adaptive"."""
        return "flows" if self.flows is not None else "step" if self.step is not None else "adaptive"

    def suits(self, system: System) -> str:
        """ "" if the method is for this system, otherwise why not, to go on after "NAME: ...", without a full stop."""
        if self.systems and system.name not in self.systems:
            return f"it is written for {', '.join(sorted(self.systems))} only, not for {system.name}"
        if self.variables != "entropy" and not system.defines("entropies"):
            solved = f"it solves for {SOLVED_FOR[self.variables]} in the place of entropies"
            return f"{solved}, and {system.name} has no elements with both: {ELEMENTS}"
        if self.elements and not system.defines("element_energy"):
            own = "its formulas are written in elements with a strain and an entropy each"
            return f"{own}, and {system.name} has none: {ELEMENTS}"
        if missing := ", ".join(name for name in self.needs if not system.defines(name)):
            lacks = f"it needs {missing}, which the system {system.name} does not define"
            return system.excludes(self) or f"{lacks}: write {missing}() in its class, or {TAKE_ANY}"
        return system.excludes(self) or (self.refuses(system) if self.refuses else "")

    @property
    def sources(self) -> tuple[str, ...]:
        """What a method that wraps this one `uses`: its plugin, and what it uses itself."""
        return tuple(dict.fromkeys(filter(None, (self.plugin, *self.uses))))

    def versions(self) -> dict[str, str | None]:
        """Versions of the packages that the method requires; None for an absent one."""
        return {name: installed_version(name) for name in self.requires}

    @property
    def lacks(self) -> str:
        """ "" if all that the method requires is installed, otherwise what is not and how to get it, as in `suits`."""
        if not self.requires:
            return ""
        absent = " ".join(name for name, version in self.versions().items() if version is None)
        return f"it needs packages that are not installed: pip install {absent}" if absent else ""

    def variant(self, **values: str) -> Integrator:
        """The member of the family with these parameters; the first allowed value is the default."""
        for name, value in values.items():
            if name not in self.parameters:
                raise unknown_name(f"parameter of {self.name!r}", name, self.parameters)
            if value not in self.parameters[name]:
                raise unknown_name(f"value of {name!r}", value, self.parameters[name])
        changed = {n: v for n, v in values.items() if v != self.parameters[n][0]}
        if not changed:
            return self
        assert self.family is not None
        label = ",".join(f"{n}={v}" for n, v in sorted(changed.items()))
        key = tuple(sorted(changed.items()))  # one object a member: looked up twice it is equal to itself
        member = self._members.get(key) or self._members.setdefault(key, self.family(**changed))
        return replace(member, name=f"{self.name}[{label}]", plugin=self.plugin, base=self.name)

    def variants(self) -> list[Integrator]:
        """Every member of the family, the default first."""
        names, values = list(self.parameters), list(self.parameters.values())
        return [self.variant(**dict(zip(names, choice, strict=True))) for choice in itertools.product(*values)]


def family(make: Callable[..., Integrator], **parameters: Any) -> Integrator:
    """The default member of a parametrized method; `name[param=value]` picks another.

    Parameters
    ----------
    make : function
        `make(**parameters)` returns the Integrator for given values, which are strings.
    **parameters : sequence of str, or function
        The possible values of each, the first being the default; or a function of all registered integrators
        (name -> Integrator) that returns them, called once every plugin has been loaded.

    Returns
    -------
    Integrator
        To be returned by the hook `tcbench_integrators`.

    Raises
    ------
    TcbenchError
        For a parameter without values, and what `make` raises for the default ones.

    References
    ----------
    docs/add-integrator.md.
    """
    expect("family", {"make": make}, {"make": "a function"})
    expect("family", parameters, dict.fromkeys(parameters, "words or numbers or a function"))
    allowed = {n: v if callable(v) else tuple(str(x) for x in v) for n, v in parameters.items()}
    default = make()
    if not isinstance(default, Integrator):
        raise TcbenchError(f"family: make returns {shown(default)}; it has to return an Integrator.")
    return replace(default, parameters=allowed, family=make)


def _check_variables(where: str, variables: Any) -> None:
    if not (isinstance(variables, str) and variables in SOLVED_FOR):
        raise TcbenchError(f"{where}: variables must be 'entropy', 'temperature' or 'energy', not {variables!r}.")


def _as_flows(flows: Any, variables: str) -> tuple[Flow, ...]:
    """Callables, (callable, fraction) pairs and Flows, as Flows."""
    if callable(flows) or isinstance(flows, Flow):
        flows = [flows]
    if isinstance(flows, list | tuple) and not flows:
        raise TcbenchError("An integrator's flows= has no formula; give one function, or several.")
    result = []
    for item in flows if isinstance(flows, list | tuple) else [flows]:
        if isinstance(item, Flow):
            result.append(item)
            continue
        function, fraction = item if isinstance(item, tuple) and len(item) == 2 else (item, 1.0)
        result.append(Flow(function, fraction, variables))
    return tuple(result)
