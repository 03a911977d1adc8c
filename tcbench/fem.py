"""Meshes and finite elements of scikit-fem as the tables and constants of a system over spaces: the extra `fem`.

    mesh = skfem.MeshTet.load("part.msh")           # gmsh, VTK, Abaqus, ... by meshio
    fem = tcbench.fem.tabulate(mesh, skfem.ElementTetP1())
    tables = {"of": ("gauss", 4, "node")}           # in the class of the system
    constants = {"slopes": ("gauss", 4, 3), "shape": ("gauss", 4), "weight": ("gauss",), "volume": ("node",)}

Each point of the quadrature is an entry of one space, each degree of freedom of a scalar field one of another. F of a
map q of the nodes is `np.einsum("gai,gaj->gij", q[self.of], self.slopes)`, an integral `(self.weight * f).sum()`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import TcbenchError

Floats = NDArray[np.float64]


class Tabulated(NamedTuple):
    """A mesh and an element, at every point of a quadrature: g points, a functions each, in d dimensions, n nodes.

    of : (g, a), which nodes; shape : (g, a) and slopes : (g, a, d), the functions and their gradients there; weight :
    (g,), volumes of the points; volume : (n,), the part of the whole that each node has, positive; places : (n, d).
    """

    of: NDArray[np.int64]
    shape: Floats
    slopes: Floats
    weight: Floats
    volume: Floats
    places: Floats

    @property
    def constants(self) -> dict[str, Any]:
        """All but the places, by name: values for a `Scenario`."""
        return {name: x for name, x in self._asdict().items() if name != "places"}


def tabulate(mesh: Any, element: Any, order: int | None = None, facets: Any = None) -> Tabulated:
    """Tables and constants of a scalar element of scikit-fem on its mesh.

    order: that of polynomials which the quadrature integrates exactly, by default twice the element's (of
    quadrilaterals and hexahedra in each direction); linear simplices, whose gradients are constant, have one point.
    facets: of the boundary, as for loads, in the place of the elements. TcbenchError where scikit-fem is missing, for
    elements of vectors and for flat ones. Source: Gustafsson and McBain (2020), scikit-fem, doi 10.21105/joss.02369.
    """
    skfem = needed("skfem", "scikit-fem")
    rule: dict[str, Any] = {}
    simplex = len(mesh.t) == mesh.dim() + 1
    if order is None and simplex and element.maxdeg == 1 and facets is None:  # its own rule of lowest order has more
        corner = np.full((mesh.dim(), 1), 1.0 / (mesh.dim() + 1))
        rule = {"quadrature": (corner, np.array([1.0 / np.prod(np.arange(1, mesh.dim() + 1))]))}
    tensor = len(mesh.t) == 2 ** mesh.dim() and not simplex  # whose degree scikit-fem adds up over the directions
    first = 2 * element.maxdeg // (mesh.dim() if tensor else 1) if order is None else order
    for more in range(5) if "quadrature" not in rule else (0,):  # some rules have points of negative weight
        rule = rule if "quadrature" in rule else {"intorder": first + more}
        if facets is not None:
            basis = skfem.FacetBasis(mesh, element, facets=facets, **rule)
        else:
            basis = skfem.Basis(mesh, element, **rule)
        if basis.dx.min() > 0.0:
            break
    else:
        raise TcbenchError("The mesh has elements of no volume, or no rule of quadrature with positive weights.")
    fields = [basis.basis[a][0] for a in range(basis.Nbfun)]
    if np.ndim(fields[0]) != 2 or fields[0].grad is None:
        raise TcbenchError(
            f"tabulate() takes an element of a scalar field that has gradients, not {type(element).__name__}: a map of "
            "nodes has one such function for all its components, ElementTetP1() or ElementHex1()."
        )
    shape_of = basis.dx.shape  # elements, points of each
    shape = np.stack([np.broadcast_to(np.asarray(f), shape_of).ravel() for f in fields], axis=-1)
    slopes = np.stack(
        [np.broadcast_to(f.grad, (mesh.dim(), *shape_of)).reshape(mesh.dim(), -1) for f in fields], axis=1
    )
    of = np.repeat(basis.element_dofs.T, shape_of[1], axis=0).astype(np.int64)
    weight = basis.dx.ravel()
    volume: Any = np.bincount(of.ravel(), (weight[:, None] * shape).ravel(), basis.N)
    if facets is None and volume.min() <= 0.0:  # of quadratic elements: in proportion to the squares
        points = np.arange(len(weight)) // shape_of[1]
        whole, squares = np.bincount(points, weight), np.zeros((shape_of[0], of.shape[1]))
        np.add.at(squares, points, weight[:, None] * shape**2)
        share = squares * (whole / squares.sum(axis=1))[:, None]
        volume = np.bincount(basis.element_dofs.T.ravel(), share.ravel(), basis.N)
    return Tabulated(of, shape, slopes.transpose(2, 1, 0).copy(), weight, volume, basis.doflocs.T.copy())


def needed(module: str, package: str) -> Any:
    """The module, of the extra `fem`; TcbenchError where it is not installed."""
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError:
        raise TcbenchError(f"Meshes need {package}: pip install 'tcbench[fem]'.") from None
