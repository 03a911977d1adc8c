"""What a class of systems must not say is refused with a sentence; what would be right for some methods only, too."""

import copy
import inspect
import pickle

import numpy as np
import pytest
from mechanics import Mechanical

import tcbench
from tcbench import Scenario, TcbenchError
from tcbench.systems.pendulum import Pendulum

START = tcbench.scenarios()["short_term"]


def scenario(kind, **constants):
    return Scenario(
        name=kind.name, system=kind, constants={**START.constants, **constants}, positions=START.positions,
        momenta=START.momenta, temperatures=START.temperatures, t_end=0.2, dt=0.05,
    )  # fmt: skip


DERIVED = ["vector_field", "gradient", "discrete_gradient", "jacobian", "energy", "observe", "dissipation", "L", "size",
           "symbolic", "kernel"]  # fmt: skip


@pytest.mark.parametrize("name", ["n_positions", "n_elements"])
def test_springs_say_how_many_there_are(name):
    with pytest.raises(TcbenchError, match=f"Own does not say how many there are of its .*: {name} = 2, or tables"):
        scenario(type("Own", (Pendulum,), {"name": "own", name: 0}))


@pytest.mark.parametrize("name", DERIVED)
def test_what_is_derived_is_not_overridden(name):
    expected = rf"Own sets '{name}', which is derived from the formulas.* An author writes .*inertia, shape"
    with pytest.raises(TcbenchError, match=expected):
        type("Own", (Pendulum,), {name: lambda self, z: z})
    later = type("Own", (Pendulum,), {})
    setattr(later, name, lambda self, z: z)
    with pytest.raises(TcbenchError, match=expected):
        scenario(later)
    with pytest.raises(TcbenchError, match=expected.replace("Own", "Pendulum")):
        setattr(scenario(Pendulum).model, name, lambda z: z)


def test_neither_is_what_an_author_writes_replaced_in_one_instance():
    with pytest.raises(TcbenchError, match="Pendulum sets 'conduction'"):
        scenario(Pendulum).model.conduction = lambda theta: 0 * theta


@pytest.mark.parametrize("name", ["energy", "inertia", "name", "size", "state", "log_strain", "two words", "formulas"])
def test_a_constant_has_a_name_of_its_own(name):
    with pytest.raises(TcbenchError, match=f"Own: (no constant can be called|a constant is named by a word).*{name}"):
        type("Own", (Pendulum,), {"constants": {**Pendulum.constants, name: ()}})


def test_constants_may_be_called_as_arrays_and_states_call_theirs_and_shadow_numbers():
    class Own(Pendulum):
        name = "own"
        constants = {**Pendulum.constants, "T": (), "q": (), "mass": ()}
        mass = 7.0

        def element_energy(self, pi, s):
            return super().element_energy(pi, s) + self.T + self.q + self.mass

    model, plain = scenario(Own, T=1.0, q=2.0, mass=3.0).model, scenario(Pendulum).model
    assert model.energy(START.z0) == pytest.approx(plain.energy(START.z0) + 12.0, rel=1e-15)


class Lengths(Pendulum):
    name = "lengths"

    def shape(self, q):
        return np.sqrt(super().shape(q))


class Squares(Lengths):
    """Quadratic, though nobody sees it."""

    name = "squares"

    def shape(self, q):
        return super().shape(q) ** 2


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang", "tc_gonzalez"])
def test_strain_measures_that_are_not_quadratic_have_no_discrete_gradient(method):
    line = inspect.unwrap(Lengths.shape).__code__.co_firstlineno
    with pytest.raises(
        TcbenchError, match=rf"test_refusals.py, line {line}: the strain measure of element 0 is not lin"
    ):
        tcbench.simulate(method, scenario(Lengths))
    run = tcbench.simulate(method, scenario(Squares))
    assert run.ok and run.summary.energy_error_max < 1e-12


def test_other_methods_take_any_strain_measure():
    run = tcbench.simulate("tc_gauss", scenario(Lengths))
    assert run.ok and run.summary.energy_error_max < 1e-12


class Coupled(Pendulum):
    name = "coupled"

    def element_energy(self, pi, s):
        return super().element_energy(pi, s) + 0.1 * pi[::-1]


def test_elements_whose_energies_depend_on_each_other_are_refused():
    line = inspect.unwrap(Coupled.element_energy).__code__.co_firstlineno
    with pytest.raises(
        TcbenchError, match=rf"test_refusals.py, line {line}: the energy of element 0 depends on .* 1, "
    ):
        tcbench.simulate("midpoint_entropy", scenario(Coupled))


@pytest.mark.parametrize("rates", [np.zeros(2), [0, 0]])
def test_friction_of_no_conduction_is_nil(rates):
    kind = type("Insulated", (Pendulum,), {"name": "insulated", "conduction": lambda self, theta: rates})
    assert np.asarray(scenario(kind).model.friction(np.array([300.0, 310.0]))).tolist() == [[0, 0], [0, 0]]


SIZES = {
    "conduction": lambda self, theta: np.zeros(3), "inertia": lambda self: np.ones(3), "shape": lambda self, q: q[:1],
    "entropies": lambda self, q, theta: theta[:1], "element_energy": lambda self, pi, s: pi @ s,
    "entropy_scale": lambda self: np.ones(3), "exergy_offset": lambda self: self.masses,
    "invariants": lambda self, q, p: {"momentum": p},
}  # fmt: skip


@pytest.mark.parametrize("name", SIZES)
def test_a_formula_gives_as_many_numbers_as_there_are(name):
    with pytest.raises(TcbenchError, match=rf"^Own: {name}\(\) gives an array .*; (it gives|each is)"):
        scenario(type("Own", (Pendulum,), {"name": "own", name: SIZES[name]}))


def test_an_invariant_may_be_a_number():
    one = scenario(type("Own", (Pendulum,), {"name": "own", "invariants": lambda self, q, p: {"one": 1.0}}))
    assert tcbench.simulate("tc_monolithic", one).ok and one.model.momenta(one.z0) == 1.0


def test_constants_do_not_change():
    masses = np.array([1.0, 2.0])
    one = scenario(Pendulum, masses=masses)
    masses[0] = 50.0
    assert one.model.masses.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        one.model.masses[0] = 50.0
    with pytest.raises(TcbenchError, match=r"does not change: take another one, such as scenario.replace\(masses"):
        one.model.masses = masses
    with pytest.raises(TcbenchError, match=r"do not change: take another one, scenario.replace"):
        one.constants["conductivity"] = 5.0
    assert copy.deepcopy(one) == pickle.loads(pickle.dumps(one)) == one


def test_elements_have_a_mass():
    class Light(tcbench.Pendulum):
        name = "light"

        def inertia(self):
            return np.array([1.0, 1.0, -1.0, 1.0])

    with pytest.raises(TcbenchError, match=r"Light: inertia\(\) must be positive, not -1"):
        scenario(Light)


def test_what_belongs_to_the_class_is_not_set_on_an_instance():
    class Late(tcbench.Pendulum):
        name = "late"

        def __init__(self, **values):
            super().__init__(**values)
            self.n_positions = 4

    with pytest.raises(TcbenchError, match="Late sets 'n_positions' on an instance: it belongs to the class"):
        scenario(Late)


def test_what_a_formula_reads_is_what_it_names():
    with pytest.raises(TcbenchError, match="Reading writes __getattribute__"):

        class Reading(tcbench.Pendulum):
            def __getattribute__(self, name):
                return object.__getattribute__(self, name)


def test_a_class_without_a_name_is_called_by_its_own():
    """Sentences said: no variable of '' is called 'w'."""

    class Unnamed(Mechanical):
        constants = {"k": ()}

        def energy(self, z):
            return z.p**2 + self.k * z.q**2 + z.s

    class Heir(Unnamed):
        pass

    class Given(Unnamed):
        name = "given"

    assert [Unnamed.name, Heir.name, Given.name] == ["Unnamed", "Heir", "given"]
    with pytest.raises(TcbenchError, match="No variable of 'Unnamed' is called 'w'"):
        Scenario("x", Unnamed, {"k": 1}, initial={"q": 1, "p": 0, "s": 0, "w": 1}, t_end=1, dt=0.1)


@pytest.mark.parametrize("called", ["inv", "det", "solve"])
def test_linear_algebra_of_single_numbers_is_refused_with_what_to_write(called):
    """A double pendulum's mass matrix: numpy's own words were of a ufunc and dtype('O')."""

    def energy(self, z):
        matrix = np.array([[2.0 + 0.0 * z.q, np.cos(z.q)], [np.cos(z.q), 1.0 + 0.0 * z.q]])
        function = getattr(np.linalg, called)
        return np.sum(function(matrix, np.array([z.p, 0 * z.p])) if called == "solve" else function(matrix)) + z.p**2

    kind = type("Double", (Mechanical,), {"name": "double", "energy": energy})
    run = Scenario("double", kind, {}, initial={"q": 0.1, "p": 0.2, "s": 0.0}, t_end=1.0, dt=0.1)
    with pytest.raises(TcbenchError, match=rf"np.linalg.{called} of formulas runs on tensors .* has the inverse"):
        tcbench.simulate("tc_monolithic", run)
