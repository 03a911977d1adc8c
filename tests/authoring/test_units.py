"""Units of measure that an author declares: a formula that disagrees is told with its line."""

import numpy as np
import pytest
from mechanics import OfEntropies, Warm

import tcbench
from tcbench import ElementSystem, System, TcbenchError
from tcbench.authoring.units import check_units, unit


class Oscillator(Warm):
    """A mass on two springs, with friction that heats a bath, and a clock of another unit."""

    name = "oscillator"
    variables = {"q": (2,), "p": (2,), "s": ()}
    constants = {"mass": (), "stiffness": (2,), "friction_": (), "capacity": (), "warm": (), "power": ()}
    reference_temperature = "warm"
    units = {
        "q": "m", "p": "kg m/s", "s": "J/K", "mass": "kg", "stiffness": ["N/m", "N/m^3"], "friction_": "kg/s",
        "capacity": "J/K", "warm": "K",
    }  # fmt: skip

    def energy(self, z):
        linear, cubic = self.stiffness
        r = np.sqrt(z.q @ z.q)
        bath = self.capacity * self.warm * (np.exp(z.s / self.capacity) - 1)
        return z.p @ z.p / (2 * self.mass) + linear / 2 * r**2 + cubic * r**self.power + bath

    def irreversible(self, z, dE, dS):
        force = self.friction_ * dE.p
        return {"p": -force, "s": np.sum(force * dE.p) / dE.s}

    def exergy_offset(self):
        return -self.warm * self.capacity

    def invariants(self, z):
        return {"spin": z.q[0] * z.p[1] - z.q[1] * z.p[0]}


class Matrices(Oscillator):
    reversible = System.reversible
    irreversible = System.irreversible

    def poisson(self, z):
        L = np.zeros((5, 5))
        L[0, 2] = L[1, 3] = 1
        return L - L.T

    def friction(self, z):
        v, theta = z.p / self.mass, self.warm * np.exp(z.s / self.capacity)
        B = np.array([[0, 0], [0, 0], [1, 0], [0, 1], [-v[0] / theta, -v[1] / theta]], dtype=object)
        return self.friction_ * theta * B @ B.T


def model(kind, **changed):
    units = {"units": {**kind.units, **changed.pop("units", {})}}
    constants = {"mass": 1, "stiffness": (1, 2), "friction_": 0.1, "capacity": 1, "warm": 300, "power": 4}
    return type("Wrong", (kind,), {**units, **changed})(**constants)


def test_what_agrees_passes():
    check_units(model(Oscillator))
    check_units(model(Oscillator, units={"energy": "eV", "mass": "eV s^2/m^2", "p": "eV s/m", "time": "s",
                                         "stiffness": ["eV/m^2", "eV/m^4"], "friction_": "eV s/m^2", "s": "eV/K",
                                         "capacity": "eV/K", "entropy": "eV/K"}))  # fmt: skip


def of(name, formula):
    return {name: formula}, formula


WRONG = {
    "a sum": (*of("energy", lambda self, z: z.p @ z.p / 2 + z.s * self.warm), "kg²·m²/s² and J are added"),
    "a pure number": (*of("energy", lambda self, z: self.warm * z.s + 1), "J and the pure number 1"),
    "a function": (*of("energy", lambda self, z: self.warm * self.capacity * np.exp(z.s)), "argument of exp.* not"),
    "a maximum": (*of("energy", lambda self, z: np.maximum(self.warm, z.s)), "K and J/K are added"),
    "an energy": (*of("energy", lambda self, z: z.p @ z.p), "gives the energy in .*; it is J"),
    "an entropy": (*of("entropy", lambda self, z: z.s / self.capacity), "gives the entropy in a pure number"),
    "a rate": (
        *of("irreversible", lambda self, z, dE, dS: {"p": -self.friction_ * z.p}), r"rate of p in .*; it is N",
    ),
    "a rate with S": (*of("irreversible", lambda self, z, dE, dS: {"s": dE.p @ dE.p / dE.s}), "the rate of s in"),
    "a temperature": (*of("temperature", lambda self, z, dE, dS: dS.s / dE.s), "a temperature in .*; it is K"),
    "an offset": (*of("exergy_offset", lambda self: self.warm), "the offset in K; it is J"),
    "an invariant": (*of("invariants", lambda self, z: {"x": z.q[0] + z.p[0]}), "m and .* are added"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_disagrees_is_told_with_its_line(what):
    written, formula, words = WRONG[what]
    with pytest.raises(TcbenchError, match=rf"test_units.py, line {formula.__code__.co_firstlineno}:.*{words}"):
        check_units(model(Oscillator, **written))


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ({"x": "m"}, "'x'.*capacity"), ({"q": "m/"}, "'m/' is no unit"), ({"q": ["m"]}, "1 for the 2 numbers of 'q'"),
        ({"power": "m"}, "an exponent is a pure number, not m"), ({"time": "h"}, "rate of q"),
    ],
)  # fmt: skip
def test_what_is_declared_must_make_sense(units, words):
    with pytest.raises(TcbenchError, match=words):
        check_units(model(Oscillator, units=units))


def test_matrices_too():
    check_units(model(Matrices))
    with pytest.raises(TcbenchError, match=r"friction.. of Wrong gives row 2, column 2 in .* it is"):
        check_units(model(Matrices, units={"friction_": "kg"}))


@pytest.mark.parametrize("name", ["rigid_body", "heavy_top", "reaction"])
def test_a_system_of_pure_numbers_agrees(name):
    """Every operation that the formulas use is known."""
    system = tcbench.scenarios()[name].model
    kind = type("Pure", (type(system),), {"units": {"energy": "1", "entropy": "1", "time": "1"}})
    check_units(kind(**tcbench.scenarios()[name].constants))


class Wires(ElementSystem):
    """Two thermoelastic wires in a row: each formula of elements once."""

    name = "wires"
    n_positions = n_elements = 2
    constants = {"mass": (), "stiffness": (), "mu": (), "capacity": (), "warm": (), "length": (), "coupling": ()}
    reference_temperature = "warm"
    units = {
        "q": "m", "p": "kg m/s", "s": "J/K", "mass": "kg", "stiffness": "J", "mu": "W/K", "capacity": "J/K",
        "warm": "K", "length": "m", "coupling": "J/K",
    }  # fmt: skip

    def inertia(self):
        return np.array([self.mass, 2 * self.mass])

    def shape(self, q):
        return np.array([q[0] * q[0], (q[1] - q[0]) ** 2])

    def strain(self, pi):
        return np.log(pi) / 2 - np.log(self.length)

    def element_energy(self, pi, s):
        L = self.strain(pi)
        return self.stiffness / 2 * L**2 + self.capacity * self.warm * np.exp((s - self.coupling * L) / self.capacity)

    def conduction(self, theta):
        a, b = theta
        return self.mu * np.array([(b - a) / a, (a - b) / b])

    def entropies(self, q, theta):
        return self.capacity * np.log(theta / self.warm) + self.coupling * self.strain(self.shape(q))

    def entropy_scale(self):
        return self.capacity

    def invariants(self, q, p):
        return {"spin": q[0] * p[1] - q[1] * p[0]}


FAULTY = {  # formula -> (what it becomes, what is said of it)
    "inertia": (lambda self: np.array([self.mass * self.length] * 2), "inertia.. of .* in kg·m; it is kg"),
    "shape": (lambda self, q: q, "the argument of log is a pure number, not 1/m"),
    "element_energy": (lambda self, pi, s: self.stiffness * pi, "element_energy.. of .* it is J"),
    "conduction": (lambda self, theta: self.mu * (theta - theta[::-1]), "conduction.. of .* a rate of s in W; it is"),
    "entropies": (lambda self, q, theta: np.log(theta / theta[::-1]), "entropies.. of .* an entropy in a pure number"),
    "entropy_scale": (lambda self: self.warm, "entropy_scale.. of .* in K; it is"),
    "exergy_offset": (lambda self: self.warm, "exergy_offset.. of .* the offset in K; it is J"),
    "invariants": (lambda self, q, p: {"spin": q[0] * p[1] - q[1]}, "and m are added"),
}


@pytest.mark.parametrize("name", [None, *FAULTY])
def test_formulas_of_elements_are_checked_as_well(name):
    """A logarithm of a length less that of another is that of their ratio; a wrong unit is told with its line."""
    own = {} if name is None else {name: FAULTY[name][0]}
    system = type("Mine", (Wires,), own)(mass=1, stiffness=1, mu=1, capacity=1, warm=300, length=1, coupling=0.1)
    if name is None:
        check_units(system)
        type(system).units = {x: u for x, u in Wires.units.items() if x not in ("p", "s")}  # these follow
        check_units(system)
    else:
        with pytest.raises(TcbenchError, match=rf"test_units.py, line \d+: .*{FAULTY[name][1]}"):
            check_units(system)


@pytest.mark.parametrize("name", ["short_term", "chain[n=3]"])
def test_springs_and_networks_agree_in_si_units(name, monkeypatch):
    system = tcbench.plugins.find_scenario(name).model
    given = Wires.units | {
        "masses": "kg", "natural_lengths": "m", "anchors": "m", "conductivity": "W/K", "reference_temperature": "K",
        "heat_capacity": "J/K",
    }  # fmt: skip
    known = {x: u for x, u in given.items() if x in system.constants or x in system.variables}
    monkeypatch.setattr(type(system), "units", known)
    check_units(system)
    monkeypatch.setattr(type(system), "units", known | {"coupling": "J"})
    with pytest.raises(TcbenchError, match=r"line \d+: .* and J are added"):
        check_units(system)


def test_units_are_written_as_people_write_them():
    assert unit("J/(kg K)").like(unit("m^2 s^-2 K^-1")) and str(unit("m^(1/2) m^(1/2)")) == "m"
    assert str(unit("kg m^2/s^2")) == "J" and str(unit("")) == "a pure number" and str(unit("sheep/day")) == "sheep/d"
    assert not unit("kN").like(unit("N")) and unit("kN").like(unit("mN Mm/m"))  # of one kind is not enough


def test_units_of_circuits_are_those_of_mechanics():
    """Energy, force and power by each of them."""
    for text in ("C^2/F", "Wb^2/H", "A^2 H", "V^2 S s", "A Wb", "T A m^2", "ohm A^2 s"):
        assert unit(text).like(unit("J")), text


class Sparks(OfEntropies):
    """Places some of which no wire names, and a function of what meets there."""

    name = "sparks"
    variables = {"x": ("place",), "s": ()}
    tables = {"ends": ("wire", 2, "place")}
    constants = {"reach": ("place",), "width": ("wire",), "warm": ()}
    units = {"x": "m", "s": "J/K", "reach": "m", "width": "m", "warm": "K"}

    def energy(self, z):
        return self.warm * z.s * np.exp(-(self.ends.sums(self.width[:, None] * [1, 1]) / self.reach)).sum()


def test_what_no_entry_of_a_table_names_has_the_unit_of_the_others(monkeypatch):
    system = Sparks(ends=[[0, 1]], reach=[1.0, 2.0, 3.0], width=[0.5], warm=300.0)
    check_units(system)
    monkeypatch.setattr(Sparks, "units", Sparks.units | {"width": "m^2"})
    with pytest.raises(TcbenchError, match="a pure number"):
        check_units(system)
