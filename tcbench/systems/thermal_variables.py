"""The thermal variable of elements: states with temperatures, or with energies, in the place of entropies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_states import Blocks, each, entries, refilled
from ..compiler.divided_differences import rectangle, symmetrised_slopes
from ..compiler.inverse import solved
from ..errors import TraceError
from .state import State
from .traced import derived

if TYPE_CHECKING:
    from .system import System as Base
else:
    Base = object

THERMAL = {"temperature": "theta", "energy": "u"}  # names of the last block in the place of entropies


class ThermalVariables(Base):
    """The part of an `ElementSystem` that changes between entropies, temperatures and energies; all is derived."""

    def state(self, values: Any) -> State:
        """`System.state`, in which (q, p, theta) and (q, p, u) keep their names."""
        names = getattr(values, "layout", None) or getattr(values, "names", None) or ()
        other = next((name for name in THERMAL.values() if name in names), "")
        return self.named(values, other) if other else super().state(values)

    def named(self, y: Any, last: str) -> State:
        """y with this name for its last block: "theta" in (q, p, theta), "u" in (q, p, u), "s" whatever it is."""
        y = super().state(y)
        if self.by_array:
            return cast(State, Blocks(y.blocks, {"q": 0, "p": 1, last: 2}))
        return State(y, {last if name == "s" else name: place for name, place in self.layout.items()})

    @derived
    def temperature_variables(self, z: Any) -> Any:
        """(q, p, theta) from (q, p, s), shape (size,) each."""
        z = self.state(z)
        return self.named(np.concatenate([z.q, z.p, self.temperatures(z)]), "theta")

    @derived
    def entropy_variables(self, y: Any) -> Any:
        """(q, p, s) from (q, p, theta), shape (size,) each."""
        y = self.named(y, "s")  # whatever its last block is called
        return self.state(np.concatenate([y.q, y.p, self.entropies(y.q, y.s)]))

    @derived
    def energy_variables(self, z: Any) -> Any:
        """(q, p, u) from (q, p, s), with the energies u of the elements."""
        z = self.state(z)
        return self.named(np.concatenate([z.q, z.p, self.element_energy(self.shape(z.q), z.s)]), "u")

    @derived
    def variables_of_energies(self, y: Any) -> Any:
        """(q, p, s) from (q, p, u), shape (size,) each."""
        y = self.named(y, "s")
        _, s = self.by_thermal_variable("energy", self.shape(y.q), y.s)
        return self.state(np.concatenate([y.q, y.p, s]))

    @derived
    def temperature_forces(self, y: Any) -> Any:
        """-dE/dq at (q, p, theta), shape (n_positions,), simplified: logarithms cancel exponentials of entropies."""
        y, q, theta = self.named(y, "s"), self.fresh("q", "position"), self.fresh("theta", "element")
        z = self.entropy_variables(np.concatenate([q, 0.0 * q, theta]))
        at_y = dict(zip(entries(q, theta), entries(y.q, y.s), strict=True))
        forces = [*map(trace.lifted, entries(-self.gradient(z).q))]
        return refilled(q, trace.substitute(forces, at_y))

    def in_variables(self, variables: str, z: Any) -> State:
        """z as (q, p, s), or (q, p, theta), or (q, p, u): "entropy", "temperature", "energy"."""
        maps = {"entropy": self.state, "temperature": self.temperature_variables, "energy": self.energy_variables}
        return self.named(maps[variables](z), THERMAL.get(variables, "s"))  # a kernel's numbers have lost the name

    def from_variables(self, variables: str, y: Any) -> State:
        """(q, p, s) from what `in_variables` gives."""
        maps = {"entropy": self.state, "temperature": self.entropy_variables, "energy": self.variables_of_energies}
        return maps[variables](y)

    def entropy_increments(self, variables: str, y0: State, y1: State) -> Any:
        """s(y1) - s(y0), of states as `in_variables` gives them; an operator on symbols.

        By divided differences: the difference of two logarithms would lose digits at every step.
        """
        y0, y1 = self.named(y0, "s"), self.named(y1, "s")
        pi0, dpi, dy = self.shape(y0.q), self.shape(y1.q) - self.shape(y0.q), y1.s - y0.s
        try:
            _, s = self.by_thermal_variable(variables, *each(rectangle, pi0, dpi, y0.s, dy, count=2))
        except TraceError:  # an operation without a rule, which methods without discrete gradients may do without
            return self.from_variables(variables, y1).s - self.from_variables(variables, y0).s
        by_pi, by_y = each(symmetrised_slopes, s, count=2)
        return by_pi * dpi + by_y * dy

    def simplified_energies(self, pi: Any, s: Any) -> Any:
        """Energies of the elements on corners of divided differences, by the formula as symbols simplify it; TraceError
        with the line of an operation without a rule."""
        try:
            return self.by_thermal_variable("entropy", pi, s)[0]
        except TraceError:
            return self.element_energy(pi, s)

    def by_thermal_variable(self, variables: str, pi: Any, y: Any) -> tuple[Any, Any]:
        """(energies, entropies) of the elements as functions of strain measures and of y: their entropies, temperatures
        or energies; an operator on symbols, or on the corners of divided differences.

        TraceError where the energy cannot be solved for the entropy operation by operation, or entropies() reads
        positions in another way than through the strain measures.
        """
        pi_, y_ = self.fresh("pi", "element"), self.fresh("y", "element")
        if variables == "entropy":
            s = y_
        elif variables == "temperature":
            s = self._entropies_at(pi_, marked_positive(y_))
        else:
            s_ = self.fresh("s", "element")
            s = each(solved, self.element_energy(pi_, s_), s_, y_)
        e = y_ if variables == "energy" else self.element_energy(pi_, s)
        values_of = dict(zip(entries(pi_, y_), entries(pi, y), strict=True))
        values = trace.substitute([*map(trace.lifted, entries(e, s))], values_of)
        return refilled(pi_, values[: len(entries(pi_))]), refilled(pi_, values[len(entries(pi_)) :])

    def _entropies_at(self, pi: Any, theta: Any) -> Any:
        """entropies(q, theta), which its author writes in the positions, as a function of the strain measures."""
        q = self.fresh("q", "position")
        shape, s = entries(self.shape(q)), [*map(trace.lifted, entries(self.entropies(q, theta)))]
        measures = {node: p for x, p in zip(shape, entries(pi), strict=True) for node in _itself(x)}
        entropies = trace.substitute(s, measures)
        if set(trace.depends_on(entropies, entries(q))) & {x.number for x in trace.topological(entropies)}:
            raise trace.refused(
                f"entropies() of {self.name!r} sees the positions other than through the strain measures",
                "A method in temperatures needs them as a function of those: write entropies() in self.shape(q)",
            )
        return refilled(theta, entropies)


def _itself(x: Any) -> list[trace.Symbol]:
    """The nodes of a strain measure, marked and unmarked; none of a number."""
    nodes = [x, *x.args] if isinstance(x, trace.Symbol) and x.op == "mark" else [x]
    return [node for node in nodes if isinstance(node, trace.Symbol) and node.op != "const"]


def marked_positive(theta: Any) -> Any:
    """Temperatures, declared positive: exp(log(theta)) is theta."""
    trace.positive(entries(theta))
    return theta
