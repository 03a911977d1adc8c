"""From meshes and elements of scikit-fem to tables: its own stiffness and mass; what is of no use is refused."""

import numpy as np
import pytest

from tcbench.errors import TcbenchError
from tcbench.fem import tabulate

skfem = pytest.importorskip("skfem")
KINDS = [("MeshTet", "ElementTetP1"), ("MeshTet", "ElementTetP2"), ("MeshHex", "ElementHex1"),
         ("MeshTri", "ElementTriP1"), ("MeshTri", "ElementTriP2"), ("MeshQuad", "ElementQuad1"),
         ("MeshLine", "ElementLineP1")]  # fmt: skip


@pytest.mark.parametrize(("mesh", "element"), KINDS, ids=lambda x: x)
def test_stiffness_and_mass_are_those_of_scikit_fem(mesh, element):
    from skfem.models.poisson import laplace
    from skfem.models.poisson import mass as mass_form

    m, e = getattr(skfem, mesh)().refined(1), getattr(skfem, element)()
    m = m.translated(0.1 * np.ones(m.dim())).scaled(1.3)
    for form, order in ((laplace, None), (mass_form, 2 * e.maxdeg if "P" in element else None)):
        found = tabulate(m, e, order)
        K = form.assemble(skfem.Basis(m, e)).toarray()
        f = found.slopes if form is laplace else found.shape[:, :, None]
        ours = np.zeros_like(K)
        np.add.at(ours, (found.of[:, :, None], found.of[:, None, :]), np.einsum("g,gai,gbi->gab", found.weight, f, f))
        assert np.allclose(ours, K, atol=1e-13 * np.abs(K).max())
        assert found.volume.min() > 0 and found.weight.min() > 0
        assert np.isclose(found.volume.sum(), 1.3 ** m.dim()) and np.isclose(found.weight.sum(), 1.3 ** m.dim())
        assert np.allclose(np.einsum("gai,gaj->gij", found.slopes, found.places[found.of]),
                           np.eye(m.dim()))  # fmt: skip


def test_facets_carry_loads():
    mesh = skfem.MeshHex().refined(1)
    top = mesh.facets_satisfying(lambda x: np.isclose(x[2], 1))
    found = tabulate(mesh, skfem.ElementHex1(), facets=top)
    force = np.bincount(found.of.ravel(), (found.weight[:, None] * found.shape).ravel(), len(found.places))
    assert np.isclose(force.sum(), 1) and np.allclose(force[found.places[:, 2] < 1], 0)


def test_elements_without_gradients_and_a_missing_library_are_told(monkeypatch):
    with pytest.raises(TcbenchError, match="a scalar field that has gradients, not ElementVector"):
        tabulate(skfem.MeshTri(), skfem.ElementVector(skfem.ElementTriP1()))
    monkeypatch.setitem(__import__("sys").modules, "skfem", None)
    with pytest.raises(TcbenchError, match=r"pip install 'tcbench\[fem\]'"):
        tabulate(None, None)
