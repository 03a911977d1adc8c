"""Tensors of components over spaces, and choices: values, slopes and discrete gradients are numpy's own."""

import numpy as np
import pytest

from tcbench import System, TcbenchError
from tcbench.compiler.kernels import namespace, straight_line
from tcbench.systems.over_spaces import _body_kernel
from tcbench.systems.traced import Traced

PLACES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
CORNERS = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
C4 = np.random.default_rng(3).standard_normal((2, 3, 3, 3, 3))
WEIGHTS = np.linspace(1, 2, 3)


def slopes():
    edges = PLACES[CORNERS[:, 1:]] - PLACES[CORNERS[:, :1]]
    inverse = np.linalg.inv(edges)
    return np.concatenate([-inverse.sum(axis=2)[:, None, :], inverse.transpose(0, 2, 1)], axis=1)


FORMULAS = {  # of F, shape (cells, 3, 3), the corners x (cells, 4, 3), and a system that has A (3, 3) and C4
    "einsum": lambda F, x, s: np.einsum("eij,eik->ejk", F, F)[:, 0, 1] ** 3,
    "einsum with dots": lambda F, x, s: np.einsum("...ij,...ij", F, F) ** 2,
    "einsum of all": lambda F, x, s: np.einsum("eij,ekl,eijkl->", F, F, s.C4),
    "einsum with a fixed one": lambda F, x, s: np.einsum("eij,jk,eik->e", F, s.A, F),
    "matmul": lambda F, x, s: (F.transpose(0, 2, 1) @ F)[:, 0, 2] ** 2,
    "mT": lambda F, x, s: (F.mT @ F @ F)[:, 1, 2],
    "fixed matrices": lambda F, x, s: (s.A @ F @ s.A + F @ s.A[0][:, None]).sum(axis=(1, 2)) ** 2,
    "dot": lambda F, x, s: F[:, :, 0].dot(s.A)[:, 1] ** 2 + np.dot(F, s.A[1])[:, 0] ** 3,
    "swapaxes": lambda F, x, s: (np.swapaxes(F, 1, 2) * F.swapaxes(1, 2) * F).sum(axis=(1, 2)),
    "det": lambda F, x, s: np.log(np.linalg.det(F)) ** 2,
    "det of 2 x 2": lambda F, x, s: np.linalg.det(F[:, :2, 1:]) ** 2,
    "inv": lambda F, x, s: (np.linalg.inv(F) ** 2).sum(axis=(2, 1)),
    "inv of 2 x 2": lambda F, x, s: np.linalg.inv(F[:, :2, :2])[:, 0, 1] ** 2,
    "trace": lambda F, x, s: np.trace(F @ F, axis1=1, axis2=2) ** 2 + np.linalg.trace(F) ** 3,
    "tensordot": lambda F, x, s: np.tensordot(F, s.A, axes=2) ** 2 + np.tensordot(F, F, axes=3),
    "norm": lambda F, x, s: np.linalg.norm(F, axis=(1, 2)) ** 3 + np.linalg.norm(x, axis=2).sum(axis=1),
    "reshape": lambda F, x, s: (F.reshape(-1, 9)[:, ::2] ** 3).sum(axis=1) + np.expand_dims(F, 1)[:, 0, 0, 1] ** 2,
    "keepdims": lambda F, x, s: ((F - F.mean(axis=(1, 2), keepdims=True)) ** 4).sum(axis=-1).sum(axis=-1),
    "where": lambda F, x, s: np.where(F > 0.1, (F - 0.1) ** 2, 0.0).sum(axis=(1, 2)),
    "where of two": lambda F, x, s: np.where((F > 0) & ~(F > 1), F**2 * (1 - F) ** 2, 0.0).sum(axis=(1, 2)),
    "maximum": lambda F, x, s: (np.maximum(F, 0.2) ** 2 * s.A).sum(axis=(1, 2)) + np.minimum(F[:, 0, 0], F[:, 1, 1]),
    "sign and clip": lambda F, x, s: (np.sign(F) * F**3 + np.clip(F, -0.5, 0.9) ** 2).sum(axis=(1, 2)),
    "max of components": lambda F, x, s: F.max(axis=(1, 2)) ** 2 - F.min(axis=2).sum(axis=1),
}  # fmt: skip
REAL = ("norm", "sign and clip")  # no step in complex numbers


class Cells(System):
    """Two tetrahedra with a face in common."""

    variables = {"q": ("node", 3)}
    tables = {"of": ("cell", 4, "node")}
    constants = {"mass": ("node",), "slopes": ("cell", 4, 3), "A": (3, 3), "C4": ("cell", 3, 3, 3, 3)}

    def entropy(self, z):
        return z.q.sum()


def cells(formula):
    def energy(self, z):
        x = z.q[self.of]
        found = formula((x[:, :, :, None] * self.slopes[:, :, None, :]).sum(axis=1), x, self)
        return found.sum() if np.ndim(found) else found

    cls = type("Cells", (Cells,), {"name": "cells", "energy": energy})
    matrix = np.add.outer(WEIGHTS, WEIGHTS**2)
    return cls(of=CORNERS, mass=np.ones(5), slopes=slopes(), A=matrix, C4=C4)


def evaluated(model, name, arrays, *states):
    """A derived function by its kernel, run as plain Python: traced entry by entry, or on arrays."""
    body = getattr(type(model), name).__wrapped__
    text, table = "", None
    if arrays:
        kernel = _body_kernel(model.by_arrays, body, len(states))[0].kernel(model.mesh)
        text, table, size = kernel.text, kernel.table, kernel.size
    else:
        text, shape = Traced._traced(model, body, (model.size,) * len(states), straight_line)
        size = int(np.prod(shape))
    scope = namespace() | {"table": table}
    exec(text, scope)
    out = np.zeros(size)
    scope["kernel"](np.concatenate(states), model.declared_values, out)
    return out


def ends():
    rng = np.random.default_rng(1)
    return [PLACES.ravel() * 1.1 + 0.3 * rng.standard_normal(15) for _ in range(2)]


@pytest.mark.parametrize("arrays", [False, True], ids=["entries", "arrays"])
@pytest.mark.parametrize("name", FORMULAS)
def test_values_slopes_and_divided_differences_are_those_of_numpy(name, arrays):
    model, (a, b) = cells(FORMULAS[name]), ends()

    def plain(z):
        return type(model).energy.__wrapped__(model, model.state(z))

    here, there = plain(a), plain(b)
    assert np.isclose(evaluated(model, "energy", arrays, a)[0], here, rtol=1e-13)
    step = 1e-5 if name in REAL else 1e-30j
    along = [plain(a + step * e) for e in np.eye(15)]
    differences = [(x - plain(a - step * e)) / (2 * step) for x, e in zip(along, np.eye(15), strict=True)]
    expected = np.real(differences) if name in REAL else np.imag(along) / 1e-30
    size = np.abs(expected).max()
    assert np.allclose(evaluated(model, "gradient", arrays, a), expected, atol=size * (1e-8 if name in REAL else 1e-13))
    forward, backward = (evaluated(model, "discrete_gradient", arrays, *x) for x in ((a, b), (b, a)))
    assert np.isclose(forward @ (b - a), there - here, rtol=0, atol=1e-13 * (abs(here) + abs(there)))
    assert np.allclose(forward, backward, atol=1e-12 * np.abs(forward).max())
    near = evaluated(model, "discrete_gradient", arrays, a - 1e-7, a + 1e-7)
    assert np.allclose(near, expected, atol=1e-6 * size)


def test_at_the_kink_itself_a_choice_is_the_mean_of_both():
    def choice(F, x, s):
        return np.where(x > 1.0, x**2, x).sum(axis=(1, 2))

    model = cells(choice)
    for arrays in (False, True):
        z = np.ones(15)
        counts = np.repeat(np.bincount(CORNERS.ravel()), 3)
        assert np.allclose(evaluated(model, "gradient", arrays, z), 1.5 * counts)
        assert np.allclose(evaluated(model, "discrete_gradient", arrays, z, z), 1.5 * counts)


@pytest.mark.parametrize(
    ("formula", "sentence"),
    [(lambda F, x, s: F.transpose(2, 1, 0), r"np.transpose would move the axis of cells. .*transpose\(0, 2, 1\)"),
     (lambda F, x, s: np.reshape(F, (9, -1)), "are not moved so|would move the axis"),
     (lambda F, x, s: np.trace(F), "axis1=1, axis2=2"),
     (lambda F, x, s: np.linalg.det(x), r"of matrices of up to 3 rows, not of components \(4, 3\)"),
     (lambda F, x, s: np.linalg.eigvalsh(F), "eigenvalues have no slope where two of them meet.*np.trace"),
     (lambda F, x, s: np.einsum("iej,iek->ejk", F, F[:, :, 0]), "axes. One letter each"),
     (lambda F, x, s: np.einsum("eij,ije->e", F, F), "together with components. The cells have a letter"),
     (lambda F, x, s: np.tensordot(F, F), "together with components"),
     (lambda F, x, s: F @ F[:, 0], 'np.einsum\\("eij,ej->ei"'),
     (lambda F, x, s: np.dot(F, F), "Write A @ B"),
     (lambda F, x, s: np.where(F > 0), "asks for places"),
     (lambda F, x, s: np.where(F == 0, 1.0, F), "whether they are equal"),
     (lambda F, x, s: F if (F > 0) else x, "a branch on the value"),
     (lambda F, x, s: np.interp(F, [0, 1], [0, 1]), "np.interp is not known.*Known are .*einsum"),
     (lambda F, x, s: F.sum(axis=5), "axis 5 is out of bounds"),
     (lambda F, x, s: F.cumprod(axis=1), "has no 'cumprod'")],
)  # fmt: skip
def test_what_is_not_known_is_refused_with_the_line_and_the_cure(formula, sentence):
    model = cells(formula)
    with pytest.raises(TcbenchError, match=r"test_tensors.py, line \d+: .*" + sentence):
        evaluated(model, "energy", True, ends()[0])
