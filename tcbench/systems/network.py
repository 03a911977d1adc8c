"""`Network`: a system of equal elements between positions, and equal links between elements, of any size.

The author writes what one element and one link do; where they are is a table. A formula is then traced once, on one
element for all of them, and becomes loops: what a step costs follows the size, what a start costs hardly does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler import spaces
from ..compiler.kernels import Kernel
from ..compiler.once import cached_property
from ..compiler.sentences import mixed_up
from ..compiler.space_kernels import SCALAR, Mesh, Slot, SpaceKernel, space_kernel
from ..compiler.spaces import Count, Map
from ..compiler.symbols import Symbol, array
from ..errors import TcbenchError, TraceError
from .element_system import ElementSystem
from .refusals import check_degree
from .same_for_all import require_same
from .state import State, fixed
from .traced import FEW, KEPT, attributes, derived

Ints = NDArray[np.int64]
SPACES = ("position", "element", "link", "point")


class Network(ElementSystem):
    """Base class of systems of masses and elements of any number; see `ElementSystem` for what is common to all.

    The author writes `inertia`, `element_energy`, `entropies` as for others, and instead of shape and conduction:
    `element_shape(q)`: strain measure, from the k coordinates of an element; `link(a, b)`: the entropy rates of the two
    elements of a link from their temperatures, a * rate_a + b * rate_b = 0; and, optionally, `point_invariants(q, p)`,
    the share of one mass in the invariants, by name. All of them get arrays, one entry for each element, link or mass,
    and do the same with every entry.

    Parameters
    ----------
    **values : number or array
        A value for each constant, shape (n_elements,) for one of the elements; dimensionless.

    Attributes
    ----------
    elements : array of int, shape (n_elements, k)
        The positions (coordinates) that each element sees. Numbers from n_positions on are the fixed coordinates
        `anchors`, in their order.
    links : array of int, shape (n_links, 2)
        Pairs of elements between which heat is conducted.
    points : array of int, shape (n_points, d)
        The coordinates of each mass, for invariants; optional.
    anchors : array, shape (n_anchors,)
        Coordinates that do not move.
    constants : mapping
        Name -> "position", "element", "link" or "point" (one number for each) or a shape.

    Raises
    ------
    TcbenchError
        As of `ElementSystem`. Formulas that treat elements differently are traced as a whole, which takes longer.

    References
    ----------
    The pendulum of Romero (2009), section 4, has two elements and one link; docs/chain.md, docs/add-system.md.
    """

    elements: ClassVar[Any] = np.zeros((0, 1), np.int64)
    links: ClassVar[Any] = np.zeros((0, 2), np.int64)
    points: ClassVar[Any] = np.zeros((0, 1), np.int64)
    anchors: ClassVar[Any] = np.zeros(0)
    written = (
        *(name for name in ElementSystem.written if name not in ("shape", "conduction", "n_elements")),
        "elements", "links", "points", "anchors", "element_shape", "link", "point_invariants",
    )  # fmt: skip
    spaces_of_constants: ClassVar[Mapping[str, str]] = {}
    traced_by_spaces: bool = False
    anchor_symbol: Symbol  # of one that is

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        for name in ("elements", "links", "points"):
            setattr(cls, name, np.ascontiguousarray(getattr(cls, name), dtype=np.int64))
        cls.anchors = np.ascontiguousarray(cls.anchors, dtype=float)
        cls.n_elements = len(cls.elements)
        if "constants" in cls.__dict__:
            declared = cls.__dict__["constants"]
            cls.spaces_of_constants = {n: s for n, s in declared.items() if isinstance(s, str)}
        sizes = cls.mesh_sizes()
        for name, space in cls.spaces_of_constants.items():
            if space not in SPACES:
                raise TcbenchError(
                    f"{cls.__name__}: the constant {name!r} is one number for each {space!r}; known are "
                    f"{', '.join(SPACES)}."
                )
        of_spaces = {n: (sizes[s],) for n, s in cls.spaces_of_constants.items()}
        cls.constants = {n: of_spaces.get(n, s) for n, s in cls.constants.items()}
        cls._check_tables()

    @classmethod
    def mesh_sizes(cls) -> dict[str, int]:
        """How many there are of each space."""
        counted = {"element": len(cls.elements), "link": len(cls.links), "point": len(cls.points)}
        return {"position": cls.n_positions, "anchor": len(cls.anchors), **counted}

    @classmethod
    def _check_tables(cls) -> None:
        limits = {
            "elements": cls.n_positions + len(cls.anchors), "links": len(cls.elements), "points": cls.n_positions,
        }  # fmt: skip
        for name, limit in limits.items():
            table = getattr(cls, name)
            if table.ndim != 2 or (name == "links" and table.shape[1] != 2):
                raise TcbenchError(f"{cls.__name__}: {name} is a table, one row for each; its shape is {table.shape}.")
            if table.size and not (table.min() >= 0 and table.max() < limit):
                raise TcbenchError(
                    f"{cls.__name__}: {name} names {table.min()} to {table.max()}; there are 0 to {limit - 1}."
                )
        times = np.bincount(cls.points.ravel(), minlength=cls.n_positions)
        if len(cls.points) and not np.all(times == 1):
            wrong = int(np.argmax(times != 1))
            raise TcbenchError(
                f"{cls.__name__}: each position is a coordinate of one of the points, and position {wrong} of "
                f"{times[wrong]} of them. List every mass in `points`, or none."
            )

    # ---- written by the author -------------------------------------------------------------------------

    def element_shape(self, q: Any) -> Any:
        """Strain measure of an element, positive, from its coordinates q[0], q[1], ...: linear or quadratic in them.

        Of a rigid one, a heat bath, it is a constant; `rigid + (1 - rigid) * ...` with an element constant has both.
        """
        raise TypeError(f"{type(self).__name__} must define element_shape()")

    def link(self, a: Any, b: Any) -> tuple[Any, Any]:
        """Entropy rates (of the first, of the second element) of a link, from their temperatures."""
        raise TypeError(f"{type(self).__name__} must define link()")

    def point_invariants(self, q: Any, p: Any) -> dict[str, Any]:
        """Share of one mass in the invariants, from its coordinates and momenta q[0], p[0], ...; none by default."""
        return {}

    # ---- what an ElementSystem needs --------------------------------------------------------------------------

    def per_position(self, values: Any) -> Any:
        """Numbers that belong to masses ("point"), at each of their coordinates: shape (n_positions,)."""
        if not len(self.points):
            raise TcbenchError(
                f"{type(self).__name__} has no points: per_position() needs to know whose each position is."
            )
        if self.traced_by_spaces:
            path = (Map("owner", 0, "position", "point"),)
            return array(spaces.gather(x, path) for x in values)
        return np.asarray(values)[self.mesh.maps["owner"][:, 0]]

    def shape(self, q: Any) -> Any:
        return self.strains([self._at_ends(q, k) for k in range(self.elements.shape[1])])

    def strains(self, q: Any) -> Any:
        """`element_shape`, an entry for each element also where it is one number for all, as of rigid ones."""
        found = np.asarray(self.element_shape(q))
        return found if found.shape else np.full(self.n_elements, found)

    def conduction(self, theta: Any) -> Any:
        ends = ("links", 0), ("links", 1)
        if self.traced_by_spaces:
            maps = [Map(*end, "link", "element") for end in ends]
            rates = self.link(*(array(spaces.gather(x, (m,)) for x in theta) for m in maps))
            if not len(rates):
                return array([trace.const(0.0)] * len(theta))
            return array(
                spaces.scatter([(trace.lifted(rate[k]), m) for rate, m in zip(rates, maps, strict=True)])
                for k in range(len(theta))
            )
        theta, (first, second) = np.asarray(theta), self.links.T
        gained = self.link(theta[first], theta[second])
        total = np.zeros(theta.shape) if theta.dtype != object else array([trace.const(0.0)] * len(theta))
        for rate, where in zip(gained, (first, second), strict=True):
            np.add.at(total, where, rate)
        return total

    def invariants(self, q: Any, p: Any) -> dict[str, Any]:  # type: ignore[override]
        if not len(self.points):
            return {}
        columns = range(self.points.shape[1])
        local = [[self._at_points(x, k) for k in columns] for x in (q, p)]
        return {name: sum(share) for name, share in self.point_invariants(*local).items()}

    def _at_ends(self, q: Any, k: int) -> Any:
        """Coordinate k of each element."""
        if not self.traced_by_spaces:
            return np.concatenate([np.asarray(q), self.anchors])[self.elements[:, k]]
        spaces.symmetric(q)
        path = (Map("elements", k, "element", "position"),)
        anchor = self.anchor_symbol if len(self.anchors) else None
        if anchor is None:
            return array(spaces.gather(x, path) for x in q)
        return array(spaces.gather(trace.lifted(x), path, anchor) for x in q)

    def _at_points(self, x: Any, k: int) -> Any:
        if not self.traced_by_spaces:
            return np.asarray(x)[self.points[:, k]]
        spaces.symmetric(x)
        return array(spaces.gather(v, (Map("points", k, "point", "position"),)) for v in x)

    def shape_gradient(self, q: Any) -> Any:
        if not self.traced_by_spaces:
            return super().shape_gradient(q)
        return _LocalSlope(self, q)

    def check_shape(self, q: Any) -> None:
        if not self.traced_by_spaces:
            return super().check_shape(q)
        local = [self.fresh(f"q{k}", "element") for k in range(self.elements.shape[1])]
        check_degree(self, list(self.strains(local))[:1], [x for pair in local for x in pair])
        return None

    def slopes(self, value: Any, by: Any) -> Any:
        if not self.traced_by_spaces:
            return super().slopes(value, by)
        found = spaces.gradient(trace.lifted(value), by[0])
        return array([found, spaces.twin(found)])

    def fresh(self, name: str, space: str) -> Any:
        return spaces.variable(name, space) if self.traced_by_spaces else super().fresh(name, space)

    @derived
    def temperature_field(self, y: Any) -> Any:
        """d(q, p, theta)/dt, by the chain rule from the vector field."""
        if not self.traced_by_spaces:
            return ElementSystem.temperature_field.__wrapped__(self, y)  # type: ignore[attr-defined]
        z, rate = self.fresh_state("z"), self.vector_field(self.entropy_variables(y))
        tangent = spaces.along(list(self.temperature_variables(z)), dict(zip(z, rate, strict=True)))
        here = dict(zip(z, self.entropy_variables(y), strict=True))
        return self.state(array(trace.substitute(tangent, here)))

    def fresh_state(self, name: str) -> State:
        """New variables (q, p, s)."""
        parts = [self.fresh(f"{name}{x}", s) for x, s in zip("qps", ("position", "position", "element"), strict=True)]
        return self.state(np.concatenate(parts))

    @cached_property
    def constant_values(self) -> NDArray[np.float64]:
        """(time step, constants, anchors), shape (n_constant_values,): the second argument of every kernel."""
        parts = [np.ravel(getattr(self, name)) for name in self.constants]
        return fixed(np.concatenate([[0.0], *parts, self.anchors]).astype(np.float64))

    @property
    def n_constant_values(self) -> int:
        return super().n_constant_values + len(self.anchors)

    # ---- a part of it ----------------------------------------------------------------------------------

    def patch(self, most: int) -> Network:
        """The same system made of some neighbouring elements, at most so many: small enough to be traced as a whole."""
        chosen = self._neighbours(most)
        seen = np.unique(self.elements[chosen])
        positions = seen[seen < self.n_positions]
        if len(self.points):
            whole = np.isin(self.points, positions).any(axis=1)
            positions = np.unique(self.points[whole])
        anchors = seen[seen >= self.n_positions]
        links = np.flatnonzero(np.isin(self.links, chosen).all(axis=1))
        points = np.flatnonzero(np.isin(self.points, positions).all(axis=1)) if len(self.points) else np.zeros(0, int)
        number = dict(zip([*positions.tolist(), *anchors.tolist()], range(len(positions) + len(anchors)), strict=True))
        element = {int(e): k for k, e in enumerate(chosen)}
        kept = {"position": positions, "element": chosen, "link": links, "point": points}
        body = {
            "n_positions": len(positions), "anchors": self.anchors[anchors - self.n_positions],
            "elements": np.array([[number[int(i)] for i in row] for row in self.elements[chosen]], np.int64),
            "links": np.array([[element[int(e)] for e in row] for row in self.links[links]], np.int64).reshape(-1, 2),
            "points": np.array([[number[int(i)] for i in row] for row in self.points[points]], np.int64).reshape(
                -1, self.points.shape[1]
            ),
            "constants": {n: self.spaces_of_constants.get(n, s) for n, s in self.constants.items()},
            "__module__": type(self).__module__,
        }  # fmt: skip
        of = self.spaces_of_constants
        values = {n: getattr(self, n)[kept[of[n]]] if n in of else getattr(self, n) for n in self.constants}
        patch: Network = type(f"{type(self).__name__}Patch", (type(self),), body)(**values)
        return patch

    def _neighbours(self, most: int) -> Ints:
        """Elements that hang together, one at a fixed place among them if there is any."""
        fixed = np.flatnonzero((self.elements >= self.n_positions).any(axis=1))
        chosen = np.array([fixed[0] if len(fixed) else 0])
        while len(chosen) < most:
            reached = self.elements[chosen]
            touching: Any = np.isin(self.elements, reached[reached < self.n_positions]).any(axis=1)
            touching[self.links[np.isin(self.links, chosen).any(axis=1)].ravel()] = True
            further = np.setdiff1d(np.flatnonzero(touching), chosen)
            if not len(further):
                break
            chosen = np.concatenate([chosen, further[: most - len(chosen)]])
        return np.sort(chosen)

    # ---- tracing one for all ---------------------------------------------------------------------------

    @cached_property
    def mesh(self) -> Mesh:
        """Sizes and index tables, for kernels."""
        owner = np.zeros((self.n_positions, 1), np.int64)
        for k in range(self.points.shape[1] if len(self.points) else 0):
            owner[self.points[:, k], 0] = np.arange(len(self.points))
        maps = {"elements": self.elements, "links": self.links, "points": self.points, "owner": owner}
        return Mesh(self.mesh_sizes(), maps)

    @cached_property
    def symbolic(self) -> Self:
        """As of any system; `example` is one with these formulas that has numbers."""
        found: Self = super().symbolic
        found.__dict__.setdefault("example", self)
        return found

    @cached_property
    def by_spaces(self) -> Network:
        """The same network with two representatives of everything in place of all: what formulas are traced on.

        MixedSpaces where its author's formulas do not do the same with all.
        """
        clone = object.__new__(type(self))
        clone.__dict__.update(attributes(self, KEPT))
        for name in ("position", "element"):
            number = Count(spaces.REPRESENTATIVES)
            number.symbol = spaces.count(name)
            vars(clone)[f"n_{name}s"] = number
        clone.traced_by_spaces = True
        clone.anchor_symbol = spaces.variable("anchor", "anchor")[0]
        clone.anchor_symbol.twin = clone.anchor_symbol  # both representatives see all of them
        for name, shape in self.constants.items():
            space, count = self.spaces_of_constants.get(name), int(np.prod(shape))
            if space and count and sum(n == name for n, _ in self.zeros) == count:
                setattr(clone, name, array([trace.const(0.0)] * spaces.REPRESENTATIVES))
            elif space:
                setattr(clone, name, spaces.variable(name, space))
                if name in self.positive:
                    trace.positive(getattr(clone, name))
            else:
                symbols = self.symbols_of(name)
                setattr(clone, name, symbols[0] if shape == () else symbols.reshape(shape))
        clone.__dict__["symbolic"] = clone
        require_same(self.__dict__.get("example", self), clone)
        return clone

    def constant_slots(self) -> list[Slot]:
        """What stands in `constant_values`, of a network with representatives; the first is the time step."""
        slots = [Slot(SCALAR, None)]
        for name in self.constants:
            values, space = np.ravel(getattr(self, name)), self.spaces_of_constants.get(name)
            slots += [Slot(space, values[0])] if space else [Slot(SCALAR, x) for x in values]
        slots = [slot if slot.symbol is None or slot.symbol.op != "const" else Slot(slot.space, None) for slot in slots]
        return [*slots, Slot("anchor", self.anchor_symbol)]

    def _kernel(self, body: Callable[..., Any], sizes: tuple[int, ...]) -> tuple[Kernel, tuple[int, ...]]:
        if self.size <= FEW or any(n != self.size for n in sizes):
            return super()._kernel(body, sizes)
        key = (self.structure, body.__name__, sizes)
        known = _BY_SPACES.get(key)
        if known is None:
            try:
                known = self._by_spaces(body, len(sizes))
            except TraceError:  # not the same for all entries, or a derivative that is a matrix
                known = super()._kernel(body, sizes)
            _BY_SPACES[key] = known
        return known

    def _by_spaces(self, body: Callable[..., Any], count: int) -> tuple[Kernel, tuple[int, ...]]:
        net = self.symbolic.by_spaces
        with trace.tracing():
            states = [net.fresh_state(f"z{k}") for k in range(count)]
            result = np.asarray(body(net, *states))
            kinds = net.output_spaces(body.__name__, result)
            outputs, place, flat = [], 0, list(result.ravel())
            for space in kinds:
                pair = flat[place : place + (1 if space == SCALAR else spaces.REPRESENTATIVES)]
                outputs.append(Slot(space, trace.lifted(pair[0]) if space == SCALAR else spaces.symmetric(pair)))
                place += len(pair)
            inputs = {"a": [s for z in states for s in state_slots(z)], "b": net.constant_slots()}
            made = space_kernel(inputs, outputs)
        kernel = made.kernel(self.mesh)
        return kernel, (kernel.size,) if result.shape else ()

    def output_spaces(self, name: str, result: Any) -> list[str]:
        """What a derived function gives, entry by entry."""
        two = spaces.REPRESENTATIVES
        if not result.shape:
            return [SCALAR]
        if result.shape == (3 * two,) and name != "observe":
            return ["position", "position", "element"]
        if name == "observe":
            return [SCALAR] * (len(result) - 2 * two) + ["element", "element"]
        if name in ("temperatures", "shapes"):
            return ["element"]
        if name == "momenta":
            return [SCALAR] * len(result)
        raise mixed_up(f"{name!r} is not known element by element")


class _LocalSlope:
    """d(shape)/dq of a network that is traced by spaces, as an operator."""

    __array_ufunc__ = None

    def __init__(self, net: Network, q: Any) -> None:
        self.net, self.columns = net, range(net.elements.shape[1])
        local = [net.fresh(f"q{k}", "element") for k in self.columns]
        flat = [x for pair in local for x in pair]
        rows = trace.sparse_jacobian([trace.lifted(x) for x in net.strains(local)], flat)
        ends = [net._at_ends(q, k) for k in self.columns]
        here = dict(zip(flat, (x for pair in ends for x in pair), strict=True))
        two, zero = spaces.REPRESENTATIVES, trace.const(0.0)
        slopes = [[rows[r].get(two * k + r, zero) for k in self.columns] for r in range(two)]
        self.slopes = [trace.substitute(row, here) for row in slopes]

    def _map(self, k: int) -> Map:
        return Map("elements", k, "element", "position")

    def __matmul__(self, x: Any) -> Any:
        """Rates of the shapes from rates of the positions; fixed ones have none."""
        zero = trace.const(0.0)
        return array(
            sum((slope * spaces.gather(trace.lifted(v), (self._map(k),)) for k, slope in enumerate(row)), zero)
            for v, row in zip(x, self.slopes, strict=True)
        )

    def __rmatmul__(self, x: Any) -> Any:
        """Forces at the positions from stresses."""
        return array(
            spaces.scatter([(stress * slope, self._map(k)) for k, slope in enumerate(row)])
            for stress, row in zip(x, self.slopes, strict=True)
        )


def state_slots(z: Any) -> list[Slot]:
    """The three blocks of a state of representatives."""
    two = spaces.REPRESENTATIVES
    kinds = ("position", "position", "element")
    return [Slot(space, z[two * k]) for k, space in enumerate(kinds)]


def blocks(values: Sequence[Any]) -> list[Symbol]:
    """The first of each two representatives, after a look at whether the second does the same."""
    two = spaces.REPRESENTATIVES
    return [spaces.symmetric(values[i : i + two]) for i in range(0, len(values), two)]


_BY_SPACES: dict[tuple[Any, ...], Any] = {}
__all__ = ["Network", "SpaceKernel", "blocks", "state_slots"]
