"""Systems of any size: variables, constants and tables over named spaces, `{"q": ("node", 2), "s": ("spring",)}`.

The formulas are those of any system, in plain numpy, the first axis of an array its space. A small system is traced
entry by entry, a large one on arrays (`compiler.array_symbols`): its kernels are loops, and what a start costs hardly
follows the size. Small ones are traced on arrays first, as a check: a formula that does not treat all entries alike is
refused at any size.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_kernels import ArrayKernel, array_kernel
from ..compiler.array_mesh import Block, Mesh
from ..compiler.array_states import Blocks, entries, fitted, refilled
from ..compiler.array_symbols import ArraySymbol, TableSymbol
from ..compiler.arrays import NUMBER, count, variable
from ..compiler.caches import LOCK, cached, cached_property
from ..compiler.kernels import Kernel, constant_part, kernel, placed
from ..compiler.symbols import Symbol, const
from ..compiler.tables import numbered
from ..errors import TcbenchError
from . import traced
from .state import real, shape_of
from .traced import Traced

Ints = NDArray[np.int64]
Declared = Mapping[str, tuple[Any, ...]]
WHOLE = ("jacobian", "friction", "poisson")  # matrices, which are traced entry by entry
_KINDS: dict[tuple[Any, ...], Any] = {}


def space_of(declared: tuple[Any, ...]) -> str:
    """The space of a declared shape; "" where it has none."""
    return declared[0] if declared and isinstance(declared[0], str) else NUMBER


class OverSpaces(Traced):
    """The part of a `System` that knows spaces; without any, `Traced` does all."""

    tables: ClassVar[Declared] = {}  # name -> (source, columns..., target): whole numbers, given as a constant
    variables: Declared
    spaces: Mapping[str, int] = {}  # size of each space, of an instance
    by_array: bool = False  # of `by_arrays` True: it has symbols for arrays, and no size

    @classmethod
    def declared_variables(cls) -> Declared:
        """Variables as the class declares them."""
        return cls.variables

    @classmethod
    def has_spaces(cls) -> bool:
        """Is anything declared over a space?"""
        declared = (*cls.declared_variables().values(), *cls.constants.values())
        return bool(cls.tables) or any(space_of(d) for d in declared if isinstance(d, tuple))

    def _measured(self, values: Mapping[str, Any]) -> None:
        """Sizes of the spaces and the tables from the values of the constants; shapes become numbers."""
        cls = type(self)
        sizes, first_constant = dict[str, int](), dict[str, str]()
        for name, declared in {**cls.constants, **cls.tables}.items():
            space = space_of(declared)
            if not space:
                continue
            if name not in values:
                raise TcbenchError(f"System {self.name!r} needs a value for the constant {name!r}.")
            if not shape_of(values[name]):
                raise TcbenchError(f"Constant {name!r} has one entry for each {space}; it is {values[name]!r}.")
            size = len(values[name])
            if sizes.setdefault(space, size) != size:
                raise TcbenchError(
                    f"Constant {name!r} is given for {size} {space}s, and {first_constant[space]!r} for {sizes[space]}."
                )
            first_constant.setdefault(space, name)
        wanted = [*map(space_of, cls.declared_variables().values()), *(d[-1] for d in cls.tables.values())]
        for space in (part for whole in wanted if whole for part in whole.split("+")):
            if space not in sizes:
                raise TcbenchError(
                    f"{cls.__name__}: how many {space}s there are is told by a constant or a table over them, "
                    f"such as constants = {{'mass': ({space!r},)}}; there is none."
                )
        self.__dict__["spaces"] = sizes
        self.__dict__["constants"] = {n: (sizes[d[0]], *d[1:]) if space_of(d) else d for n, d in cls.constants.items()}
        self._set_variables(sizes)
        for name, (source, *columns, target) in cls.tables.items():
            table = _whole(name, values[name], (sizes[source], *columns), target, sizes)
            counts = tuple(sizes[part] for part in target.split("+"))
            self.__dict__[name] = numbered(table, counts, cls._summed(target))

    @classmethod
    def _summed(cls, target: str) -> tuple[int, ...]:
        """Numbers of the spaces of a target that have variables; the first where none has."""
        moving = set(map(space_of, cls.declared_variables().values()))
        return tuple(k for k, space in enumerate(target.split("+")) if space in moving) or (0,)

    def _set_variables(self, sizes: Mapping[str, int]) -> None:
        declared = self.declared_variables()
        self.__dict__["variables"] = {n: (sizes[d[0]], *d[1:]) if space_of(d) else d for n, d in declared.items()}

    # ---- as any system, where entries are traced one by one ----------------------------------------------

    @property
    def large(self) -> bool:
        """Are formulas traced on arrays, into loops?"""
        return bool(self.spaces) and self.size > traced.ENTRY_BY_ENTRY

    @property
    def structure(self) -> tuple[Any, ...]:
        key = super().structure
        return (*key, self.large, self.mesh_mark) if self.spaces else key

    @cached_property
    def mesh_mark(self) -> str:
        """Hash of the tables."""
        digest = hashlib.sha256(repr(sorted(self.spaces.items())).encode())
        for name in self.tables:
            digest.update(np.asarray(getattr(self, name)).tobytes())
        return digest.hexdigest()

    @property
    def kept(self) -> tuple[str, ...]:
        return (*super().kept, "spaces", "constants", "variables", "n_positions", "n_elements", *self.tables)

    def with_symbols(self) -> Self:
        if not self.spaces and self.size > traced.MOST_WHOLE:
            raise TcbenchError(
                f"A state of {self.name!r} has {self.size} numbers, too many to be traced entry by entry (at most "
                f"{traced.MOST_WHOLE}). Declare as spaces what it has many of, variables = {{'q': ('node', 2), ...}}, "
                "and tables of who belongs to whom: its formulas are then traced on arrays, whatever the size "
                "(docs/add-system.md, Systems of any size)."
            )
        symbolic: Self = super().with_symbols()
        if self.spaces and "mesh" not in symbolic.__dict__:
            if not self.large:
                self.by_arrays.check()
            symbolic.__dict__.setdefault("by_arrays", self.by_arrays)
            symbolic.__dict__.setdefault(
                "mesh", self.mesh
            )  # last: other threads take it for the sign that all is there
        return symbolic

    def name_constants(self) -> None:
        """Symbols of a large system are made when they are read: only its matrices are traced entry by entry."""
        if not self.large:
            super().name_constants()

    def __getattr__(self, name: str) -> Any:
        if name in self.__dict__.get("constants", ()) and self.__dict__.get("by_arrays", self) is not self:
            super().name_constants()
            return self.__dict__[name]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @cached_property
    def mesh(self) -> Mesh:
        """Sizes of the spaces and tables, for kernels."""
        return Mesh(self.spaces, {n: np.asarray(getattr(self, n)) for n in self.tables})

    # ---- on arrays ---------------------------------------------------------------------------------------

    @cached_property
    def by_arrays(self) -> Any:
        """The system that formulas of all sizes are traced on: it has symbols for arrays, constants and tables."""
        some = (n for n, shape in self.constants.items() if shape and 0 not in shape)
        switched_off = frozenset(n for n in some if not np.any(getattr(self, n)))
        numbers = tuple(pair for pair in self.zeros if not space_of(type(self).constants[pair[0]]))
        key = (type(self), self.formulas, switched_off, numbers)
        with LOCK:
            if key not in _KINDS:
                _KINDS[key] = self._by_arrays(switched_off)
            return _KINDS[key]

    def _by_arrays(self, switched_off: frozenset[str]) -> Any:
        cls, kind = type(self), object.__new__(type(self))
        own = kind.__dict__
        own.update(by_array=True, formulas=self.formulas, variables=self.declared_variables(), symbolic=kind)
        own.update(n_positions=count("position"), n_elements=count("element"), magnitudes=self.magnitude_symbols())
        own["size"] = sum(count(space_of(d)) * len(entries(fresh(n, d))) for n, d in cls.declared_variables().items())
        for name, (source, *columns, target) in cls.tables.items():
            places = np.arange(np.prod(columns, dtype=int)).reshape(columns)
            own[name] = TableSymbol(name, source, target, places, cls._summed(target))
        for name, declared in cls.constants.items():
            if not space_of(declared):
                symbols = self.symbols_of(name)
                own[name] = symbols[0] if declared == () else symbols.reshape(declared)
                continue
            own[name] = fresh(name, declared)
            if name in switched_off:
                own[name] = refilled(own[name], [const(0.0)] * len(entries(own[name])))
            if name in self.positive:
                trace.positive(entries(own[name]))
        return kind

    def check(self) -> None:
        """TraceError where a formula does not treat all entries of a space alike; of `by_arrays`."""
        if "checked" not in self.__dict__:
            with trace.tracing():
                self.observe(self.fresh_state("z"))
                whole = self
                if self.multipliers:  # whose right-hand side is not traced on arrays
                    from . import constrained

                    like = constrained.conditions(cast(Any, self), self.fresh_state("z"))
                    whole = constrained.pulled(self, constrained.symbols_like(like, "lam"))
                whole.vector_field(self.fresh_state("z"))
            self.__dict__["checked"] = True

    def fresh_state(self, name: str) -> Blocks:
        """A state of new symbols for arrays."""
        return self.array_state(Blocks([fresh(f"{name}.{n}", d) for n, d in self.declared_variables().items()]))

    def array_state(self, values: Any) -> Blocks:
        """Arrays as a state with names; TraceError where a space or the number of components is another."""
        declared = self.declared_variables()
        if not isinstance(values, Blocks) or len(values.blocks) != len(declared):
            raise trace.refused(
                f"a state of {self.name!r} is made of {', '.join(declared)}, and not of {values!r}",
                "np.concatenate([z.q, z.p, z.s]) makes one",
            )
        likes = [fresh(name, d) for name, d in declared.items()]
        blocks = [fitted(x, like, repr(n)) for x, like, n in zip(values.blocks, likes, declared, strict=True)]
        return Blocks(blocks, self.block_numbers())

    def block_numbers(self) -> dict[str, int]:
        """The number of each variable's block in a state of arrays."""
        return {name: k for k, name in enumerate(self.declared_variables())}

    def blocks(self, value: Any) -> list[Block]:
        """Arrays and numbers as blocks of the input or output of a kernel."""
        return list(_blocks(value))

    def compiled(
        self, arguments: Sequence[Any], values: Sequence[Any], hoisted: Sequence[Symbol] = (), in_rows: int = 0
    ) -> Kernel | ArrayKernel:
        """A kernel from states and numbers to states and numbers: `arguments` in a, constants in b, and behind these
        the `hoisted` values. Of `by_arrays` it consists of loops, and nothing is hoisted."""
        if self.by_array:
            return array_kernel({"a": self.blocks([*arguments]), "b": self.constant_blocks()}, self.blocks([*values]))
        constants = self.constant_symbols() | placed("b", hoisted, self.n_constant_values)
        return kernel(placed("a", entries(*arguments)) | constants, list(map(trace.lifted, entries(*values))), in_rows)

    def hoisted(self, bodies: Iterable[Sequence[Any]], arguments: Sequence[Any]) -> list[Symbol]:
        """The parts of `values`, as of `compiled`, that depend on constants alone: they are computed once a run."""
        if self.by_array:
            return []
        return constant_part([trace.lifted(x) for values in bodies for x in entries(*values)], entries(*arguments))

    def constant_blocks(self, h: Symbol | None = None) -> list[Block]:
        """The blocks of `constant_values`: time step, constants, magnitudes; None where a constant is switched off."""
        blocks = [Block(NUMBER, (h,))]
        for name, declared in type(self).constants.items():
            symbols = (None if x.op == "const" else x for x in entries(getattr(self, name)))
            blocks.append(Block(space_of(declared), tuple(symbols)))
        return [*blocks, Block(NUMBER, tuple(self.magnitudes))]

    def _kernel(self, body: Callable[..., Any], sizes: tuple[int, ...]) -> tuple[Kernel, tuple[int, ...]]:
        if self.large and body.__name__ in WHOLE and self.size > traced.MOST_WHOLE:
            raise TcbenchError(
                f"{body.__name__}() of {self.name!r}, of {self.size} numbers, is a dense matrix, which is traced entry "
                f"by entry (at most {traced.MOST_WHOLE}). tcbench.systems.sparse_jacobian has the sparse Jacobian."
            )
        whole = body.__name__ in WHOLE or (body.__name__ == "vector_field" and bool(self.multipliers))
        if not self.large or any(n != self.size for n in sizes) or whole:
            return super()._kernel(body, sizes)
        key = (self.structure, body, sizes)
        if key not in traced._KERNELS:
            loops, single = _body_kernel(self.by_arrays, body, len(sizes))
            kernel = loops.kernel(self.mesh)
            traced._KERNELS[key] = kernel, () if single else (kernel.size,)
        return traced._KERNELS[key]


@cached
def _body_kernel(net: Any, body: Callable[..., Any], states: int) -> tuple[ArrayKernel, bool]:
    """The kernel of a formula of `states` states, for all sizes; and whether it gives one number."""
    with trace.tracing():
        arguments = [net.fresh_state(f"z{k}") for k in range(states)]
        result = body(net, *arguments)
        single = not isinstance(result, Blocks | ArraySymbol) and not np.ndim(result)
        return net.compiled(arguments, [result]), single


def _whole(name: str, value: Any, shape: tuple[int, ...], target: str, sizes: Mapping[str, int]) -> Ints:
    """The table of this name, whole numbers of members of the target, read-only; TcbenchError for other values."""
    count = sum(sizes[part] for part in target.split("+"))
    try:
        numbers = real(value)
    except (TypeError, ValueError):
        raise TcbenchError(f"The table {name!r} has whole numbers, not {value!r:.60}.") from None
    if np.asarray(value).dtype == bool:
        raise TcbenchError(
            f"The table {name!r} has whole numbers, no truth values: np.flatnonzero() of them is a table."
        )
    if numbers.shape == (0,) and 0 in shape:  # of an empty space a list does not say the rest
        numbers = numbers.reshape(shape)
    if numbers.shape != shape:
        raise TcbenchError(f"The table {name!r} must have shape {shape}, not {numbers.shape}.")
    if numbers.size and not (np.all(numbers % 1 == 0) and numbers.min() >= 0 and numbers.max() < count):
        raise TcbenchError(
            f"The table {name!r} names {target}s from 0 to {count - 1}; it has {numbers.min():g} to {numbers.max():g}."
        )
    table = numbers.astype(np.int64)
    table.setflags(write=False)
    return table


def fresh(name: str, declared: tuple[Any, ...]) -> Any:
    """New symbols for a variable or constant of this declared shape."""
    space = space_of(declared)
    shape = declared[1:] if space else declared  # of one entry
    parts = trace.array(variable(name, space) for _ in range(int(np.prod(shape, dtype=int)))).reshape(shape)
    return ArraySymbol(space, parts) if space else parts[()]


def _blocks(value: Any) -> Any:
    if isinstance(value, Blocks):
        for x in value.blocks:
            yield from _blocks(x)
    elif isinstance(value, ArraySymbol):
        yield Block(value.space, tuple(map(trace.lifted, entries(value))))
    elif isinstance(value, list | tuple):
        for x in value:
            yield from _blocks(x)
    elif isinstance(value, Symbol):
        yield Block(value.space, (value,))
    elif np.size(value):
        yield Block(NUMBER, tuple(map(trace.lifted, entries(value))))
