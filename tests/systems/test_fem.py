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


def test_a_mesh_of_gmsh_is_read_with_its_numbers(tmp_path):
    """A unit cube of twelve tetrahedra about its middle, as gmsh writes it."""
    corners = ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "0 0 1", "1 0 1", "1 1 1", "0 1 1", "0.5 0.5 0.5"]
    faces = ["1 2 3", "1 3 4", "5 7 6", "5 8 7", "1 6 2", "1 5 6", "2 7 3", "2 6 7", "3 8 4", "3 7 8", "4 5 1", "4 8 5"]
    nodes = [f"{k} {x}" for k, x in enumerate(corners, 1)]
    cells = [f"{k} 4 2 1 1 {face} 9" for k, face in enumerate(faces, 1)]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", "9", *nodes, "$EndNodes"]
    (tmp_path / "part.msh").write_text("\n".join([*lines, "$Elements", "12", *cells, "$EndElements", ""]))
    found = tabulate(skfem.MeshTet.load(str(tmp_path / "part.msh")), skfem.ElementTetP1())
    assert found.places.shape == (9, 3) and np.isclose(found.weight.sum(), 1) and (found.of[:, 3] == 8).all()


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
