"""Static solutions of loaded systems: those of linear elasticity at small loads, and what is said of others."""

import numpy as np
import pytest
from tcbench_plugins.continua.solid import Hexes, Tets, l_block, solid

import tcbench
from tcbench import TcbenchError
from tcbench.systems.statics import at_rest

skfem = pytest.importorskip("skfem")


class _Loaded:
    def energy(self, z):
        return super().energy(z) - (self.load * z.q).sum()


class LoadedTets(_Loaded, Tets):
    name = "loaded_tets"
    constants = Tets.constants | {"load": ("node", 3)}


class LoadedHexes(_Loaded, Hexes):
    name = "loaded_hexes"
    constants = Hexes.constants | {"load": ("node", 3)}


def loaded(element, size):
    """The block, clamped where x = 0, drawn along z at its other end."""
    plain = solid(1, element)
    q = np.array(plain.initial["q"])
    constants = plain.constants | {"expansion": 0.0, "load": size * (q[:, :1] > 1.5) * [0, 0.3, 1.0]}
    system = {"tet": LoadedTets, "hex": LoadedHexes}[element]
    start = {"q": q, "p": 0 * q, "s": np.zeros(len(q))}
    one = tcbench.Scenario(system.name, system, constants, initial=start, t_end=1.0, dt=0.1, shows="", source="")
    return one, q[:, 0] < 1e-9


@pytest.mark.parametrize("element", ["tet", "hex"])
def test_small_loads_have_the_solution_of_linear_elasticity(element):
    from skfem.models.elasticity import linear_elasticity

    basis = skfem.Basis(
        l_block(1, element),
        skfem.ElementVector(skfem.ElementHex1() if element == "hex" else skfem.ElementTetP1()), intorder=2,
    )  # fmt: skip
    K, place = linear_elasticity(20.0, 10.0).assemble(basis).tocsr(), basis.nodal_dofs.T  # (nodes, 3)
    gaps = []
    for size in (2e-4, 1e-4):
        one, held = loaded(element, size)
        force = np.zeros(K.shape[0])
        force[place] = one.constants["load"]
        u = skfem.solve(*skfem.condense(K, force, D=place[held].ravel()))[place]
        moved = np.asarray(at_rest(one, held=held).initial["q"]) - np.asarray(one.initial["q"])
        gaps.append(np.abs(moved - u).max() / np.abs(u).max())
    assert gaps[1] < 1e-4 and 1.9 < gaps[0] / gaps[1] < 2.1  # what is left is of second order in the load


def test_large_loads_are_in_balance_and_stay_there():
    """Held by stiff ties in the place of a clamp, the run that begins there does not move."""
    one, held = loaded("hex", 0.4)
    still = at_rest(one, held=held)
    z = still.z0
    force = np.reshape(one.model.gradient(z)[: 3 * len(held)], (-1, 3))
    assert np.abs(force[~held]).max() < 1e-12 and np.abs(force[held]).max() > 0.1
    moved = np.asarray(still.initial["q"]) - np.asarray(one.initial["q"])
    assert moved[:, 2].max() > 0.2  # as large as a third of a cube: far from linear
    pendulum = tcbench.plugins.find_scenario("gas_tube[n=20]").replace(p=np.zeros(19))
    begun = at_rest(pendulum, "x")
    run = tcbench.simulate("tc_monolithic", begun.replace(conductivity=0.0), t_end=0.1)
    assert run.ok and np.ptp(run.z, axis=0).max() < 1e-13


def test_what_has_no_static_solution_is_told():
    one, held = loaded("tet", 1e-4)
    with pytest.raises(TcbenchError, match=r"does not resist some motion of 'q': hold what is clamped"):
        at_rest(one)
    with pytest.raises(TcbenchError, match="True or False for each number of 'q'"):
        at_rest(one, held=[True])
    with pytest.raises(TcbenchError, match="variable of 'loaded_tets'"):
        at_rest(one, "x", held=held)
    with pytest.raises(TcbenchError, match="no least energy"):
        at_rest(loaded("tet", -30.0)[0], held=held)
