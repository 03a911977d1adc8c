"""Formulas on arrays have the numbers that numpy has, whatever way they are written in, or are refused."""

import numpy as np
import pytest

import tcbench
from tcbench import Scenario, System, TcbenchError
from tcbench.systems import traced

SIGNS = np.array([1.0, -2.0])


class Plain(System):
    variables = {"q": ("node", 2), "v": ("node",), "W": ("node", 2, 3), "s": ("spring",), "b": ()}
    tables = {"ends": ("spring", 2, "node"), "one": ("spring", "node")}
    constants = {"mass": ("node",)}

    def entropy(self, z):
        return z.b


def model(formula):
    kind = type("Own", (Plain,), {"name": "own", "energy": lambda self, z: formula(self, z)})
    ends = [[0, 1], [1, 2], [3, 3], [2, 0], [0, 1]]
    return kind(ends=ends, one=[0, 2, 2, 1, 0], mass=np.arange(1.0, 5.0))


EQUAL = {
    "sum of the last axis, which is the first": lambda m, z: (z.v - z.v.sum(axis=-1)).sum(),
    "norm": lambda m, z: (z.v * np.linalg.norm(z.v, axis=-1)).sum(),
    "mean": lambda m, z: (z.v * z.v.mean(axis=-1)).sum() + (z.q * z.q.mean(axis=-2)).sum(),
    "axes counted from the end": lambda m, z: (z.W * z.W.sum(axis=-3)).sum() + z.W.mean(axis=-2)[:, 1].sum(),
    "stack": lambda m, z: np.stack([z.q, 2 * z.q], axis=-2)[:, 1, 0].sum(),
    "columns of columns": lambda m, z: np.column_stack([z.v, z.q])[:, 0].sum(),
    "columns": lambda m, z: np.column_stack([z.q, 3 * z.q])[:, 2].sum(),
    "joined along the last axis": lambda m, z: np.concatenate([z.v, z.s], axis=-1).sum(),
    "weights of columns": lambda m, z: (m.ends.sums(SIGNS) * z.v).sum() + (m.ends[:, ::-1].sums([1, 2]) * z.v).sum(),
    "rows": lambda m, z: (z.q.T[::-1][0] - z.q.T[0]).sum() + len(z.q.T) * z.b,
}
REFUSED = {
    "rows doubled": (lambda m, z: (2 * z.q.T)[0].sum(), "arithmetic with x.T"),
    "rows added": (lambda m, z: (z.q.T + z.q.T)[0].sum(), "arithmetic with x.T"),
    "rows of rows": (lambda m, z: (z.q.T[:1] + z.q.T[1:])[0].sum(), "arithmetic with x.T"),
    "mask": (lambda m, z: (z.s * (m.one == 0)).sum(), "the numbers of the table 'one'"),
    "other mask": (lambda m, z: (z.s * (m.ends[:, 0] != 0)).sum(), "the numbers of the table 'ends'"),
    "in place": (lambda m, z: z.s.__iadd__(1.0).sum(), "changed in place"),
    "size": (lambda m, z: z.b * np.size(m.ends), "or how many, are asked for"),
    "shape": (lambda m, z: z.b * len(np.shape(m.ends)), "or how many, are asked for"),
    "different ones": (lambda m, z: z.b * len(np.unique(m.ends)), "or how many, are asked for"),
}


@pytest.mark.parametrize("few", [0, 10**6], ids=["large", "small"])
@pytest.mark.parametrize("name", EQUAL)
def test_numbers_are_those_of_numpy(name, few, monkeypatch):
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", few)
    system = model(EQUAL[name])
    z = np.cos(1.3 * np.arange(system.size))
    assert system.energy(z) == pytest.approx(float(EQUAL[name](system, system.state(z))), rel=1e-14)


@pytest.mark.parametrize("few", [0, 10**6], ids=["large", "small"])
@pytest.mark.parametrize("name", REFUSED)
def test_what_would_be_taken_for_something_else_is_refused(name, few, monkeypatch):
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", few)
    formula, sentence = REFUSED[name]
    system = model(formula)
    with pytest.raises(TcbenchError, match=sentence):
        system.vector_field(np.ones(system.size))
    with pytest.raises(TcbenchError, match=sentence):
        system.symbolic.by_arrays.check()


def test_a_rate_has_the_components_of_its_variable(monkeypatch):
    """One number for each node was taken for both components of each."""
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", 0)
    body = {"name": "own", "energy": lambda self, z: (z.q**2).sum(), "irreversible": lambda self, z, dE, dS: {"q": z.v}}
    with pytest.raises(TcbenchError, match=r"the rate of 'q' has components \(2,\), and gets \(\)"):
        own = type("Own", (Plain,), body)(ends=[[0, 1]], one=[1], mass=[1.0, 2.0])
        own.vector_field(np.ones(own.size))


@pytest.mark.parametrize("few", [0, 10**6], ids=["large", "small"])
def test_what_is_empty_sums_to_nothing(few, monkeypatch):
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", few)
    kind = type("Own", (Plain,), {"name": "own", "energy": lambda self, z: (z.v * np.exp(self.one.sums(z.s))).sum()})
    system = kind(ends=[], one=[], mass=[1.0, 2.0])
    assert system.energy(np.arange(float(system.size))) == 9.0  # 4 + 5


def test_the_largest_of_none_is_not_0(monkeypatch):
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", 0)
    kind = type("Own", (Plain,), {"name": "own", "energy": lambda self, z: z.b + self.mass.max()})
    assert kind(ends=[], one=[], mass=[]).energy(np.ones(1)) == -np.inf


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [({"invariants": lambda self, z: {"mass": z.v}}, "invariants.. of Own: each is one number, not 'mass' <array over"),
     ({"variables": {"v": ("node",)}, "entropy": lambda self, z: z.v.sum()}, "all spaces are empty")],
)  # fmt: skip
def test_sentences(changes, sentence):
    kind = type("Own", (Plain,), {"name": "own", "energy": lambda self, z: z.v.sum(), **changes})
    start = {name: np.zeros([0] * len(shape)) for name, shape in kind.variables.items()}
    with pytest.raises(TcbenchError, match=sentence):
        own = Scenario("own", kind, {"ends": [], "one": [], "mass": []}, initial=start, t_end=1.0, dt=0.1)
        tcbench.simulate("tc_monolithic", own)
