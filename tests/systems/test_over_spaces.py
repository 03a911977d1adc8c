"""Systems over spaces: one class small and large, its numbers the author's own, wrong use told in a sentence."""

import copy
import pickle

import numpy as np
import pytest
from mechanics import OfEntropies

import tcbench
from tcbench import Scenario, System, TcbenchError
from tcbench.systems import traced
from tcbench.systems.sparse_jacobian import sparse_jacobian

from ..helpers.networks import NETWORKS, N, Row, cells, row

SMALL = {"ends": [[0, 1], [1, 2], [2, 3], [0, 4]], "pairs": [[0, 1], [1, 2], [3, 0]], "mass": np.ones(4),
         "stiffness": np.full(4, 10.0), "q": [[1.0, 0.0], [2.0, 0.1], [3.0, 0.0], [4.0, 0.2]],
         "p": np.zeros((4, 2)), "s": [0.1, 0.0, -0.1, 0.05]}  # fmt: skip


@pytest.mark.parametrize("name", NETWORKS)
def test_derived_functions_are_the_authors_own(name):
    scenario = NETWORKS[name]
    model, z = scenario.model, scenario.z0
    state = model.state(z)
    assert model.large and model.size == len(z)
    for formula in ("energy", "entropy"):
        own = getattr(type(model), formula).__wrapped__(model, state)
        assert getattr(model, formula)(z) == pytest.approx(own, rel=1e-14)
    gradient = np.asarray(model.gradient(z))
    step = 1e-6
    differences = [(model.energy(z + step * e) - model.energy(z - step * e)) / (2 * step) for e in np.eye(len(z))]
    assert np.allclose(gradient, differences, atol=1e-7)
    field, other = model.vector_field(z), gradient + 0.1
    assert gradient @ field == pytest.approx(0.0, abs=1e-12) and model.entropy_gradient(z) @ field > 0
    slopes = model.discrete_gradient(z, z + 0.01 * other)
    assert slopes @ (0.01 * other) == pytest.approx(model.energy(z + 0.01 * other) - model.energy(z), abs=1e-12)
    assert copy.deepcopy(scenario) == pickle.loads(pickle.dumps(scenario)) == scenario


@pytest.mark.parametrize("name", NETWORKS)
def test_the_sparse_jacobian_is_that_of_differences(name):
    scenario = NETWORKS[name]
    model, z, step = scenario.model, scenario.z0, 1e-5
    field = model.vector_field(np.concatenate([z + step * np.eye(len(z)), z - step * np.eye(len(z))]))
    differences = (field[: len(z)] - field[len(z) :]).T / (2 * step)
    assert np.abs(sparse_jacobian(model)(z).toarray() - differences).max() < 2e-9 * np.abs(differences).max()


class Led(OfEntropies):
    """All follow one leader: their rate is one number."""

    name = "led"
    variables = {"x": ("node",), "v": (), "s": ()}
    constants = {"k": ("node",)}

    def energy(self, z):
        return z.v**2 / 2 + (self.k * z.x**2 / 2).sum() + np.exp(z.s)

    def reversible(self, z, dE, dS):
        return {"x": np.zeros_like(z.x) + dE.v, "v": -dE.x.sum()}


def test_a_rate_that_is_one_number_has_a_row_for_each_entry():
    model = Led(k=np.arange(1.0, 31.0))
    found = sparse_jacobian(model)(np.ones(32)).toarray()
    assert np.array_equal(found[:30], np.outer(np.ones(30), np.arange(32) == 30))
    assert np.array_equal(found[30], [*-model.k, 0.0, 0.0])


def test_one_class_is_small_and_large():
    small = row(Row, **SMALL)
    run = tcbench.simulate("tc_monolithic", small)
    assert run.ok and run.solver.way == "unrolled: 12 unknowns" and run.summary.energy_error_max < 1e-14
    assert small.replace(kappa=1.0).system is NETWORKS["row"].system
    for name in ("scipy_dop853", "tc_gauss"):
        assert tcbench.simulate(name, small, **({"tolerance": 1e-6} if "scipy" in name else {})).ok


class Kinds(System):
    """Wires of two kinds, each an entropy; wherever two of them meet they conduct."""

    name = "kinds"
    variables = {"steel": ("steel",), "brass": ("brass",)}
    tables = {"met": ("joint", 2, "wall+steel+brass")}
    constants = {"c": ("steel",), "wide": ("brass",), "wall": ("wall",)}

    def energy(self, z):
        return (self.c * np.exp(z.steel / self.c)).sum() + (self.wide * np.exp(z.brass)).sum()

    def entropy(self, z):
        return z.steel.sum() + z.brass.sum()

    def irreversible(self, z, dE, dS):
        a, b = np.concatenate([self.wall, dE.steel, dE.brass])[self.met].T
        steel, brass = self.met.sums(np.stack([(b - a) / a, (a - b) / b], axis=1))
        return {"steel": steel, "brass": brass}


def test_sums_of_joined_spaces_are_those_of_each_that_has_variables():
    for n in (3, 20):
        met = [[1 + i, 1 + j] for i in range(n) for j in (i + 1, i + n) if j < 2 * n]
        constants = {"met": met, "c": np.linspace(1.0, 2.0, n), "wide": np.ones(n), "wall": [1.0]}
        model = copy.deepcopy(Kinds(**constants))
        z = np.cos(np.arange(2.0 * n))
        theta = np.asarray(model.gradient(z))
        expected = np.zeros(2 * n)
        for i, j in np.array(met) - 1:
            expected[[i, j]] += (theta[j] - theta[i]) / theta[[i, j]] * [1, -1]
        assert np.allclose(model.vector_field(z), expected, rtol=1e-14, atol=1e-14) and model.large == (n > 3)


class Counting(Row):
    name = "counting"

    def energy(self, z):
        return super().energy(z) / len(z.s)


class First(Row):
    name = "first"

    def irreversible(self, z, dE, dS):
        return {"s": self.kappa * (dE.s[0] - dE.s) / dE.s}


class Mixed(Row):
    name = "mixed"

    def entropy(self, z):
        return (z.s + z.p[:, 0]).sum()


class Apart(Row):
    name = "apart"

    def energy(self, z):
        return super().energy(z) + (z.s * np.arange(float(N))).sum()


class Unsummed(Row):
    name = "unsummed"

    def entropy(self, z):
        return z.s


@pytest.mark.parametrize("size", ["small", "large"])
@pytest.mark.parametrize(
    ("kind", "sentence"),
    [(Counting, "how many springs there are is not known"), (First, "springs are asked for by number"),
     (Mixed, "over springs meets one over nodes. Take it along a table"),
     (Apart, "meets one that is none. Declare it")],
)  # fmt: skip
def test_formulas_that_do_not_treat_all_alike_are_refused(kind, sentence, size):
    with pytest.raises(TcbenchError, match=rf"test_over_spaces.py, line \d+: .*{sentence}"):
        tcbench.simulate("tc_monolithic", row(kind, **(SMALL if size == "small" and kind is not Apart else {})))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [({"stiffness": np.ones(3)}, "'stiffness' is given for 3 springs, and 'ends' for 5|'ends' is given for 5 springs"),
     ({"ends": [[0, 9]] * N}, r"The table 'ends' names node\+anchors from 0 to 5; it has 0 to 9"),
     ({"ends": np.ones((N, 3))}, r"The table 'ends' must have shape \(5, 2\)"),
     ({"ends": np.full((N, 2), 0.5)}, "The table 'ends' names"),
     ({"anchors": [[1.0], [1.0, 2.0]]}, "'anchors' has one entry for each anchor"),
     ({"ends": np.ones((N, 2), bool)}, "'ends' has whole numbers, no truth values"),
     ({"mass": 1.0}, "'mass' has one entry for each node")],
)  # fmt: skip
def test_tables_and_sizes_are_checked(changes, sentence):
    with pytest.raises(TcbenchError, match=sentence):
        row(Row, **changes)


def test_declarations_are_checked():
    def declared(**body):
        return type("Own", (System,), {"name": "own", "variables": {"x": ("node",)}, **body})

    with pytest.raises(TcbenchError, match="Own: how many nodes there are is told by a constant or a table over them"):
        declared(constants={"k": ()})(k=1.0)
    with pytest.raises(TcbenchError, match="Own: the table 'ends' is declared by what has numbers"):
        declared(tables={"ends": ("spring",)})
    with pytest.raises(TcbenchError, match="Own: the shape of the variable 'x' is"):
        declared(variables={"x": ("node", "spring")})
    with pytest.raises(TcbenchError, match=r"returns one number, not .* adds up"):
        tcbench.simulate("tc_monolithic", row(Unsummed))


def test_formulas_of_all_sizes_are_traced_once():
    one, other = NETWORKS["row"], row(Row, **SMALL, kappa=3.0)
    assert one.model.by_arrays is other.model.by_arrays
    assert one.model.structure != other.model.structure and one.model.size > traced.ENTRY_BY_ENTRY


class Undeclared(System):
    name = "undeclared"
    variables = {"q": (101,), "p": (101,)}

    def energy(self, z):
        return (z.p @ z.p + z.q @ z.q) / 2

    def entropy(self, z):
        return z.q.sum()

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}


def test_what_is_too_large_to_be_traced_entry_by_entry_is_refused_with_a_cure():
    sentence = r"A state of 'undeclared' has 202 numbers, .* \(at most 200\)\. Declare as spaces what it has many of"
    scenario = Scenario(
        "undeclared", Undeclared, {}, initial={"q": np.ones(101), "p": np.zeros(101)}, t_end=1.0, dt=0.5
    )
    for method in ("tc_monolithic", "tc_gauss", "solve_ivp_radau"):
        with pytest.raises(TcbenchError, match=sentence):
            tcbench.simulate(method, scenario)
    with pytest.raises(TcbenchError, match=r"'tc_taylor' cannot run .* of 202 variables .* Declare spaces"):
        tcbench.simulate("tc_taylor", scenario)
    with pytest.raises(
        TcbenchError, match=r"jacobian\(\) of 'reactions', of 300 numbers, is a dense matrix.* has the sparse Jacobian"
    ):
        cells(100).model.jacobian(cells(100).z0)


def test_a_space_may_be_empty_and_a_system_may_only_dissipate():
    """Reactions has no reversible part here, and cells without faces; a list of no pairs does not say that they are."""
    only = type("Only", (type(cells().model),), {"name": "only", "reversible": System.reversible})
    for count in (3, 10):
        scenario = cells(count)
        given = {"next": np.zeros((0, 2)), "rate": scenario.model.rate, "diffusion": 0.3}
        z = scenario.model.state(np.array(scenario.z0))
        start = {"n": z.n, "u": z.u}
        alone = Scenario("only", only, given, initial=start, t_end=0.5, dt=0.1)
        run = tcbench.simulate("tc_monolithic", alone)
        assert run.ok and np.array_equal(run.z[-1][2 * count :], alone.z0[2 * count :])  # nothing moves between cells


def test_constants_of_a_large_system_are_no_symbols_until_a_matrix_asks_for_them():
    """Half a million of them took 8 of the 18 seconds to the first step of a solid."""
    model = tcbench.plugins.find_scenario("gas_tube[n=60]").model
    stands_for_all = model.symbolic
    assert model.large and model.invariant_names == () and "mass" not in vars(stands_for_all)
    assert len(stands_for_all.mass) == 59 and "gas" in vars(stands_for_all)
    with pytest.raises(AttributeError, match="no attribute 'weight'"):
        _ = stands_for_all.weight
