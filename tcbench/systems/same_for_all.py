"""Does a network's author do the same with every element, whatever their number?

A formula that is traced on two representatives for all of them looks alike where it is not: a mean divides by two, a
length is two. So what an author wrote is compared before it is trusted: on numbers, with fewer entries; and traced for
all against traced one by one, on a small network. What differs is traced one by one, which is slower, and right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler import spaces
from ..compiler.formula_hash import formula_hash
from ..compiler.kernels import namespace, straight_line
from ..compiler.sentences import MixedSpaces
from ..compiler.space_kernels import SCALAR, Slot, space_kernel
from ..errors import TcbenchError
from .traced import KEPT, attributes

if TYPE_CHECKING:
    from .network import Network

MOST = 12  # elements of a small network
LARGER = (12, 24, 48)  # tried in turn, until nothing of it is there as often as there are representatives
TRIES = 60  # random states, until there is one at which the formulas have values
AGREE = 1e-9  # of the largest number of a kind; sums are in another order

Floats = NDArray[np.float64]
Parts = list[tuple[str, str, Any]]  # name, space and values of an author's functions
_VERDICTS: dict[Any, str] = {}


def require_same(example: Network, net: Network) -> None:
    """MixedSpaces where a formula knows how many entries it sees, or which one it has; net: traced for all."""
    why = _knows_company(example)
    if not why:
        functions = [getattr(type(example), name, None) for name in sorted(type(example).written)]
        key = (formula_hash(*filter(callable, functions)) or example.structure, example.zeros)
        if key not in _VERDICTS:
            _VERDICTS[key] = _verdict(example, net)
        why = _VERDICTS[key]
    if why:
        raise MixedSpaces(why)


def _verdict(example: Network, net: Network) -> str:
    try:
        return _differs(small_network(example), net)
    except MixedSpaces as error:
        return str(error)
    except TcbenchError:  # wherever it is traced
        raise
    except Exception as error:  # of the author's formulas: such as an array of the network's length beside theirs
        return f"its formulas fail on some of its elements: {error}"


def small_network(network: Network) -> Network:
    """A part of the network, in which nothing is there as often as there are representatives by chance."""
    whole, two = network.mesh_sizes(), spaces.REPRESENTATIVES
    for most in LARGER:
        small = network.patch(most)
        if all(count != two or whole[space] == two for space, count in small.mesh_sizes().items() if space != "anchor"):
            return small
    return network


def random_state(small: Network, rng: np.random.Generator, attempt: int) -> Floats | None:
    """A random state with positive shapes and temperatures, if this attempt finds one."""
    n, m = small.n_positions, small.n_elements
    q = rng.normal(size=n) if attempt % 2 else np.cumsum(rng.uniform(0.5, 1.5, n))
    theta = getattr(small, "reference_temperature", 1.0) * rng.uniform(0.8, 1.2, m)
    with np.errstate(all="ignore"):
        z = np.concatenate([q, rng.normal(size=n), small.entropies(q, theta)])
        shapes = np.asarray(small.shape(q), dtype=float)
    return z if np.all(np.isfinite(z)) and np.all(shapes > 0) else None


# on numbers ---------------------------------------------------------------------------------------------------------


def _knows_company(network: Network) -> str:
    """The author's function that gives an entry other values where fewer are there; "" if none does."""
    rng = np.random.default_rng(0)
    for name, space, function in _by_entry(network, rng):
        count = network.mesh_sizes()[space]
        everyone = np.arange(count)
        with np.errstate(all="ignore"):
            try:
                whole = function(network, everyone)
            except Exception:  # not on numbers: the traces are compared
                continue
            try:
                for chosen in (everyone[: count // 2], everyone[count // 2 :], everyone[-2:], everyone[[0, -1]]):
                    part = function(_part(network, space, chosen), chosen)
                    for x, y in zip(whole, part, strict=True):
                        if not np.allclose(x[chosen], y, rtol=AGREE, atol=0.0, equal_nan=True):
                            return f"{name}() gives {space}s other values where fewer of them are there"
            except Exception as error:
                return f"{name}() fails where fewer {space}s are there: {error}"
    return ""


def _by_entry(net: Network, rng: np.random.Generator) -> Iterator[tuple[str, str, Callable[..., list[Any]]]]:
    """What acts entry by entry: name, space, and the values that a part of the network gives for these entries."""
    sizes = net.mesh_sizes()

    def random(space: str, count: int = 1) -> list[Any]:
        return list(rng.uniform(0.5, 1.5, (count, sizes[space])))

    def each(values: Sequence[Any], chosen: Any) -> list[Any]:
        return [np.broadcast_to(np.asarray(x, dtype=float), len(chosen)) for x in values]

    ends, (pi, s, theta) = random("element", net.elements.shape[1]), random("element", 3)
    q, (a, b) = random("position")[0], random("link", 2)
    if sizes["element"] > 2:
        yield "element_shape", "element", lambda part, k: each([part.element_shape([x[k] for x in ends])], k)
        yield "element_energy", "element", lambda part, k: each([part.element_energy(pi[k], s[k])], k)
        yield "entropies", "element", lambda part, k: each([part.entropies(q, theta[k])], k)
    if sizes["link"] > 2:
        yield "link", "link", lambda part, k: each(part.link(a[k], b[k]), k)
    if sizes["point"] > 2:
        at, p = (random("point", net.points.shape[1]) for _ in range(2))
        yield (
            "point_invariants", "point",
            lambda part, k: each(part.point_invariants([x[k] for x in at], [x[k] for x in p]).values(), k),
        )  # fmt: skip


def _part(network: Network, space: str, chosen: Any) -> Any:
    """The network as functions of some entries of a space see it."""
    part = object.__new__(type(network))
    part.__dict__.update(attributes(network, (*KEPT, *network.constants)))
    for name, of in network.spaces_of_constants.items():
        if of == space:
            part.__dict__[name] = getattr(network, name)[chosen]
    if space == "element":
        part.__dict__.update(elements=network.elements[chosen], n_elements=len(chosen))
    return part


# on symbols ---------------------------------------------------------------------------------------------------------


def _differs(small: Network, net: Network) -> str:
    """Which of the author's functions are another on a small network than traced for all; "" if none is."""
    with trace.tracing():
        z = net.fresh_state("z")
        slots, names = [], []
        for name, space, value in _functions(net, z):
            pair = trace.lifted(value) if space == SCALAR else spaces.symmetric(value)
            slots.append(Slot(space, pair))
            names += [name] * small.mesh.size(space)
        made = space_kernel({"a": _blocks(z), "b": net.constant_slots()}, slots).kernel(small.mesh)
    with trace.tracing():
        x = trace.variables("x", small.size)
        outputs = [
            trace.lifted(v) for _, _, value in _functions(small.symbolic, small.state(x)) for v in np.ravel(value)
        ]
        text = straight_line({s: f"a[{i}]" for i, s in enumerate(x)} | small.symbolic.constant_symbols(), outputs)
    if len(outputs) != made.size:
        return "its formulas give other numbers of values on some elements than traced on one for all"
    run = [_run(made.text, {"table": made.table}), _run(text, {})]
    rng = np.random.default_rng(0)
    for attempt in range(TRIES):
        a = np.abs(rng.uniform(0.5, 1.5, small.size) + np.arange(small.size) * (attempt % 3))
        b = rng.uniform(0.5, 1.5, len(small.constant_values)) if attempt % 2 else small.constant_values
        found, expected = (function(a, b, made.size) for function in run)
        if np.all(np.isfinite(expected)):
            for name in dict.fromkeys(names):
                of = np.array([n == name for n in names])
                if not np.all(np.abs(found - expected)[of] <= AGREE * np.abs(expected[of]).max()):
                    return f"{name} is another one on {len(small.elements)} elements than traced on one for all"
            return ""
    return "no state was found at which its formulas have values"


def _functions(net: Any, z: Any) -> Parts:
    """What everything else is derived from: name, space and values; theta stands where s does."""
    n, shapes = net.n_positions, net.shape(z.q)
    ones = np.ones(int(net.n_elements))
    energy = net.element_energy(trace.array(map(trace.lifted, shapes)), z.s)
    parts: Parts = [
        ("element_shape()", "element", shapes), ("element_energy()", "element", energy),
        ("inertia()", "position", net.inertia() * np.ones(int(n))), ("link()", "element", net.conduction(z.s)),
        ("entropies()", "element", net.entropies(z.q, z.s)), ("entropy_scale()", "element", net.entropy_scale() * ones),
        ("exergy_offset()", SCALAR, net.exergy_offset()),
    ]  # fmt: skip
    return parts + [(f"the invariant {k!r}", SCALAR, v) for k, v in net.invariants(z.q, z.p).items()]


def _blocks(z: Any) -> list[Slot]:
    two = spaces.REPRESENTATIVES
    return [Slot(space, z[two * k]) for k, space in enumerate(("position", "position", "element"))]


def _run(text: str, names: dict[str, Any]) -> Callable[[Floats, Floats, int], Floats]:
    """The kernel of a text, in Python."""
    scope = namespace() | names
    exec(compile(text, "<compared>", "exec"), scope)

    def run(a: Floats, b: Floats, size: int) -> Floats:
        out = np.zeros(size)
        with np.errstate(all="ignore"):
            scope["kernel"](a, b, out)
        return out

    return run
