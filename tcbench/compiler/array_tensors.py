"""numpy's functions of tensors, for arrays over spaces and for object arrays of symbols.

An array over a space (`array_symbols`) holds the components of one entry, an object array `parts`. For its author the
first axis is the space, which has no length.
"""

from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from .choices import KINKED
from .kinks import clip, kinked, where
from .symbols import TAKE
from .trace_errors import refused

STAND_IN = 101  # length of the space in a stand-in that shows where numpy moves components
LARGEST = 3  # rows of a matrix that has a determinant and an inverse, by cofactors
KEPT = "The first axis of an array over a space stays the first: x.transpose(0, 2, 1), x.reshape(-1, 9), axis=1"


def is_over(x: Any) -> bool:
    """Is it an array over a space?"""
    return hasattr(x, "parts")


def parts_of(x: Any) -> Any:
    return x.parts if is_over(x) else np.asarray(x, dtype=object) if np.ndim(x) else x


def _as(x: Any, parts: Any) -> Any:
    """Components as an array of the kind of x."""
    return type(x)(x.space, parts) if is_over(x) else parts


# components moved ---------------------------------------------------------------------------------------------------


def rearranged(function: Callable[..., Any], x: Any, *args: Any, **options: Any) -> Any:
    """A function of numpy that only moves components, applied to numbers that show where each one goes."""
    size = x.parts.size
    stand_in = np.arange(STAND_IN * size).reshape(STAND_IN, *x.parts.shape)
    try:
        moved = np.asarray(function(stand_in, *args, **options))
    except Exception as error:
        raise refused(f"components {x.parts.shape} of each {x.space} are not moved so ({error})", KEPT) from error
    first = moved[:1]
    entry = size * np.arange(len(moved) if moved.ndim else 0).reshape(-1, *[1] * (moved.ndim - 1))
    if moved.shape[:1] != (STAND_IN,) or np.any(moved != first + entry):
        raise refused(f"np.{function.__name__} would move the axis of {x.space}s", KEPT)
    return _as(x, x.parts.ravel()[moved[0]])


def _moving(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda x, *args, **options: rearranged(function, x, *args, **options)


# sums of products ---------------------------------------------------------------------------------------------------


def _one_space(arrays: Sequence[Any]) -> Any:
    first, *others = arrays
    for x in others:
        if x.space != first.space:
            raise refused(f"an array over {first.space}s meets one over {x.space}s", TAKE)
    return first


def contracted(terms: Sequence[str], out: str, operands: Sequence[Any]) -> Any:
    """The sum of products of entries, by letters as in einsum; the letter of the space comes first."""
    over = [(term, x) for term, x in zip(terms, operands, strict=True) if is_over(x)]
    first, letters = _one_space([x for _, x in over]), {term[:1] for term, _ in over}
    letter = letters.pop()
    inner = [term[1:] if is_over(x) else term for term, x in zip(terms, operands, strict=True)]
    if letters or any(letter in term for term in inner) or letter in out[1:]:
        raise refused(
            f"this product takes the {first.space}s together with components",
            f'The {first.space}s have a letter of their own, first everywhere: np.einsum("eij,ej->ei", A, x)',
        )
    product = np.einsum(",".join(inner) + "->" + out.replace(letter, ""), *map(parts_of, operands))
    product = _as(first, product)
    return product if letter in out else product.sum(axis=0)


def _letters(terms: list[str], out: str | None, dims: Sequence[int]) -> tuple[list[str], str]:
    """Terms with letters in the place of dots, and the output, by einsum's rule where it is not written."""
    free = [c for c in string.ascii_letters if c not in "".join(terms)]
    most = max((n - len(t) + 3 for t, n in zip(terms, dims, strict=True) if "..." in t), default=0)
    dots = "".join(free[:most])
    full = [t.replace("...", dots[most - (n - len(t) + 3) :] if n - len(t) + 3 else "")
            for t, n in zip(terms, dims, strict=True)]  # fmt: skip
    if out is None:
        every = "".join(full)
        out = dots + "".join(sorted(c for c in set(every) if every.count(c) == 1 and c not in dots))
    return full, out.replace("...", dots)


def einsum(subscripts: Any, *operands: Any, optimize: Any = False) -> Any:
    if not isinstance(subscripts, str):
        raise refused("np.einsum begins with letters", 'Write np.einsum("eai,eaj->eij", x, y)')
    left, arrow, right = subscripts.replace(" ", "").partition("->")
    terms, dims = left.split(","), [int(np.ndim(x)) for x in operands]
    if len(terms) != len(operands) or any("..." not in t and len(t) != n for t, n in zip(terms, dims, strict=False)):
        raise refused(
            f"np.einsum({subscripts!r}) is of arrays with {', '.join(map(str, dims))} axes", "One letter each"
        )
    return contracted(*_letters(terms, right if arrow else None, dims), operands)


def tensordot(a: Any, b: Any, axes: Any = 2) -> Any:
    dims = int(np.ndim(a)), int(np.ndim(b))
    if isinstance(axes, int):
        axes = [range(dims[0] - axes, dims[0]), range(axes)]
    first, second = string.ascii_letters[: dims[0]], [*string.ascii_letters[dims[0] : sum(dims)]]
    pairs = list(zip(*(np.atleast_1d(x).tolist() for x in axes), strict=True))
    for i, j in pairs:
        second[j] = first[i]
    other = "".join(second)
    out = "".join(c for c in first + other if (first + other).count(c) == 1)
    return contracted([first, other], out, [a, b])


def matmul(a: Any, b: Any) -> Any:
    """x @ y: the dot product over all entries, products of each entry's matrices, or of these with fixed numbers."""
    n, m = int(np.ndim(a)), int(np.ndim(b))
    if is_over(a) and is_over(b) and (n == m == 1 or min(n, m) > 2):
        return (a * b).sum() if n == 1 else _as(_one_space([a, b]), a.parts @ b.parts)
    if is_over(a) and not is_over(b) and n > 1 and 0 < m <= 2:
        return _as(a, a.parts @ parts_of(b))
    if is_over(b) and not is_over(a) and m > 2 and n == 2:
        return _as(b, parts_of(a) @ b.parts)
    raise refused(
        "this product is not known for arrays over spaces",
        'Write a sum, (x * y).sum(axis=1), or np.einsum("eij,ej->ei", A, x); x @ A.T is the fixed A of each x',
    )


def dot(a: Any, b: Any) -> Any:
    if max(np.ndim(a), np.ndim(b)) > 2 and min(np.ndim(a), np.ndim(b)) > 1:
        raise refused("np.dot of arrays with three axes or more", "Write A @ B, or np.einsum")
    return matmul(a, b)


# matrices of each entry ---------------------------------------------------------------------------------------------


def _matrices(x: Any, what: str) -> Any:
    parts = parts_of(x)
    rows = parts.shape[-1] if parts.ndim > 1 else 0
    if not 1 <= rows <= LARGEST or parts.shape[-2:] != (rows, rows):
        shape = f"components {parts.shape}" if is_over(x) else f"shape {parts.shape}"
        raise refused(f"np.linalg.{what} is of matrices of up to {LARGEST} rows, not of {shape}", "Write it out")
    return parts


def _cofactors(A: Any) -> Any:
    if A.shape[-1] == 1:
        return np.ones_like(A)
    if A.shape[-1] == 2:
        a, b, c, d = A[..., 0, 0], A[..., 0, 1], A[..., 1, 0], A[..., 1, 1]
        return np.stack([np.stack([d, -c], -1), np.stack([-b, a], -1)], -2)
    rows = [A[..., i, :] for i in range(3)]
    return np.stack([_crossed(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)], -2)


def _crossed(a: Any, b: Any) -> Any:
    (x, y, z), (u, v, w) = (np.moveaxis(p, -1, 0) for p in (a, b))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], -1)


def det(a: Any) -> Any:
    """Determinants by cofactors: only products, whose discrete gradient keeps all digits."""
    A = _matrices(a, "det")
    return _as(a, (A[..., 0, :] * _cofactors(A)[..., 0, :]).sum(axis=-1))


def inv(a: Any) -> Any:
    """Inverses: cofactors over the determinant."""
    A = _matrices(a, "inv")
    C = _cofactors(A)
    whole = np.asarray((A[..., 0, :] * C[..., 0, :]).sum(axis=-1), dtype=object)
    return _as(a, np.swapaxes(C, -1, -2) / whole[..., None, None])


def trace(a: Any, offset: int = 0, axis1: int = 0, axis2: int = 1) -> Any:
    if 0 in (axis1, axis2):
        raise refused("np.trace without axes takes the space for one", "Write np.trace(x, axis1=1, axis2=2)")
    return rearranged(np.diagonal, a, offset, axis1, axis2).sum(axis=-1)


def norm(x: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    several = isinstance(axis, tuple) and len(axis) == 2
    if axis is None or (ord is not None and ord != ("fro" if several else 2)):
        raise refused("this norm is not known for arrays over a space", "Write np.linalg.norm(x, axis=1), or a sum")
    return np.sqrt((x * x).sum(axis=axis, keepdims=keepdims))


def _eigenvalues(x: Any, *_: Any) -> Any:
    raise refused(
        "eigenvalues have no slope where two of them meet, as at rest",
        "Write invariants: np.trace(A, axis1=1, axis2=2), np.linalg.det(A), np.einsum('eij,eji->e', A, A)",
    )


MOVING = (np.transpose, np.permute_dims, np.swapaxes, np.moveaxis, np.rollaxis, np.matrix_transpose, np.reshape,
          np.linalg.matrix_transpose, np.expand_dims, np.squeeze, np.diagonal, np.linalg.diagonal, np.flip, np.roll,
          np.repeat, np.take, np.delete)  # fmt: skip
MATRICES: dict[Any, Callable[..., Any]] = {  # of arrays of symbols, too
    np.linalg.det: det, np.linalg.inv: inv, np.where: where, np.clip: clip,
    np.linalg.eigvalsh: _eigenvalues, np.linalg.eigh: _eigenvalues, np.linalg.eigvals: _eigenvalues,
}  # fmt: skip
TENSORS: dict[Any, Callable[..., Any]] = {
    **{f: _moving(f) for f in MOVING}, **MATRICES, np.einsum: einsum, np.tensordot: tensordot, np.dot: dot,
    np.linalg.tensordot: tensordot, np.linalg.matmul: matmul, np.trace: trace, np.linalg.norm: norm,
    np.linalg.trace: lambda a, offset=0: trace(a, offset, -2, -1),
}  # fmt: skip


class SymbolArray(np.ndarray):
    """An object array of symbols for which numpy's choices, determinants and inverses work."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        operands = [_plain(x) for x in inputs]
        into = options.get("out")
        if into is not None:
            options["out"] = tuple(map(_plain, into))
        if ufunc in KINKED and method == "__call__" and not options:
            result = kinked(ufunc)(*operands)
        elif ufunc in (np.maximum, np.minimum) and method == "reduce":
            result = _most(ufunc, operands[0], options.get("axis", 0))
        else:
            result = getattr(ufunc, method)(*operands, **options)
        return into[0] if into is not None else symbols(result)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        own, types = MATRICES.get(function), [t for t in types if issubclass(t, np.ndarray)]
        return symbols(own(*args, **kwargs) if own else super().__array_function__(function, types, args, kwargs))


def _plain(x: Any) -> Any:
    return x.view(np.ndarray) if isinstance(x, SymbolArray) else x


def symbols(x: Any) -> Any:
    """An object array as a `SymbolArray`; anything else unchanged."""
    return x.view(SymbolArray) if type(x) is np.ndarray and x.dtype == object else x


def _most(ufunc: Any, x: Any, axis: Any) -> Any:
    """The largest or smallest entry along axes."""
    of_two = kinked(ufunc)
    axes: Iterable[int] = range(x.ndim) if axis is None else [axis] if isinstance(axis, int) else axis
    for k in sorted((a % x.ndim for a in axes), reverse=True):
        x = of_two.reduce(x, axis=k)
    return x
