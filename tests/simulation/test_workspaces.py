"""A run holds its own memory: threads, copies, pickles, other runs in between and failures change no bit."""

import contextlib
import copy
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Event

import numpy as np
import pytest
from tcbench_plugins.controlled import controlled
from tcbench_plugins.projected import projected

import tcbench
from tcbench import Integrator, TcbenchError
from tcbench.compiler.kernels import Kernel
from tcbench.plugins import find_integrator, find_scenario
from tcbench.systems import traced
from tcbench.systems.over_spaces import OverSpaces

from ..helpers import networks

THREADS = 6


def richardson(z, h, system):
    step = tcbench.stepper("tc_monolithic", system)
    return (4 * step(step(z, h / 2), h / 2) - step(z, h)) / 3


def bdf2(z0, z1, h, system, before):
    return z1 - z0 - (z0 - before[0]) / 3 - 2 / 3 * h * system.vector_field(z1)


def adams(z, h, system, before):
    return z + h * (1.5 * system.vector_field(z) - 0.5 * system.vector_field(before[0]))


def with_arrays(z, h, system, work):
    work[:] = z + h / 2 * system.vector_field(z)
    return z + h * system.vector_field(work)


OWN = {
    method.name: method
    for method in (
        Integrator(name="richardson", order=4, step=richardson),
        Integrator(name="bdf2", order=2, memory=1, starter="tc_monolithic", flows=bdf2),
        Integrator(name="adams", order=2, memory=1, starter="tc_gauss", step=adams),
        Integrator(name="arrays", order=2, step=with_arrays, workspace=lambda system: np.empty(system.size)),
        controlled(find_integrator("tc_taylor[order=4]"), name="controlled_taylor"),
        projected(find_integrator("tc_gauss"), name="projected_gauss"),
        projected(find_integrator("tc_taylor[order=4]"), name="projected_taylor"),
    )
}
KINDS = [  # of every kind of method
    "tc_monolithic", "tc_strang", "midpoint_temperature", "gauss2", "verlet_heat", "projected",  # formulas
    "tc_gauss", "tc_taylor[order=8]",  # with a march
    "tc_gauss_adaptive", "tc_taylor", "tc_auto",
    "controlled[method=tc_monolithic]", "projected[method=scipy_dopri5]",
    "scipy_odeint", "solve_ivp_radau", "solve_ivp_lsoda",
    *OWN,
]  # fmt: skip
NETWORKS = ["tc_monolithic", "midpoint_temperature", "tc_gauss", "tc_auto", "solve_ivp_bdf"]
CASES = [
    *((name, "bound_equilibrium") for name in KINDS),
    *((name, network) for name in NETWORKS for network in ("chain[n=4]", "net[nx=3,ny=3]")),
    ("tc_monolithic", "gas_containers"), ("tc_gauss", "gas_containers"),
]  # fmt: skip


def variants(name):
    """Scenarios of one structure with other constants and another start."""
    scenario = find_scenario(name).replace(t_end=0.5)
    warmer = tuple(theta + 1.0 for theta in scenario.temperatures)
    return [scenario, scenario.replace(reference_temperature=301.0), scenario.replace(temperatures=warmer)]


def settings(method, dt=0.02, tolerance=1e-5):
    return {"tolerance": tolerance} if method.kind == "adaptive" else {"dt": dt}


def method_of(name):
    return OWN.get(name) or find_integrator(name)


def told(run):
    """All that is computed, to the last bit."""
    numbers = run.z.tobytes(), run.energy.tobytes()
    return run.status, run.failure, *numbers, repr(run.solver), run.summary.energy_error_max


def simulate(name, scenario, **given):
    method = method_of(name)
    return told(tcbench.simulate(method, scenario, **settings(method, **given)))


def ids(case):
    return "-".join(case)


@pytest.fixture
def often():
    """Threads take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


def at_once(function, items):
    """function of each item, by threads that begin together."""
    barrier = Barrier(len(items))

    def begin(item):
        barrier.wait()
        return function(item)

    with ThreadPoolExecutor(len(items)) as pool:
        return list(pool.map(begin, items))


# threads ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES, ids=ids)
def test_threads_give_the_bits_of_one_run_after_the_other(case, often):
    """The threads come first: what is traced and compiled for a system is so by several of them."""
    name, system = case
    scenarios = variants(system) * 2
    found = at_once(lambda scenario: simulate(name, scenario), scenarios)
    alone = [simulate(name, scenario) for scenario in variants(system)]
    assert alone[0][0] == "ok" and len({run[2] for run in alone[1:]}) == 2
    assert found == alone * 2


@pytest.mark.parametrize(
    "made", [lambda system: system.symbolic, copy.copy, pickle.dumps], ids=["symbols", "copy", "pickle"]
)
def test_what_another_thread_keeps_on_a_system_meanwhile_disturbs_nothing(made, often, monkeypatch):
    system, stop = copy.copy(find_scenario("net[nx=3,ny=3]").model), Event()

    def keep():
        while not stop.is_set():
            for k in range(50):
                vars(system)[f"kept{k}"] = k
            for k in range(50):
                del vars(system)[f"kept{k}"]

    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(keep)
        try:
            for _ in range(300):
                monkeypatch.setattr(traced, "_SYMBOLIC", {})
                vars(system).pop("symbolic", None)
                made(system)
        finally:
            stop.set()
        other.result()


def test_what_stands_for_a_net_is_whole_before_another_thread_can_take_it(monkeypatch):
    """It had its mesh, and not yet what it is traced on: another thread then branched on symbols."""

    class Fresh(networks.Row):
        name = "fresh"

    found, make = [], OverSpaces._by_arrays

    def watched(system, *given):
        found.append(["mesh" in vars(known) for known in traced._SYMBOLIC.values() if type(known) is Fresh])
        return make(system, *given)

    monkeypatch.setattr(OverSpaces, "_by_arrays", watched)
    assert networks.row(Fresh).model.n_temperatures == networks.N and found == [[False]]


def test_threads_on_one_scenario_with_different_tolerances_do_not_meet(often):
    scenario, tolerances = find_scenario("bound_equilibrium").replace(t_end=1.0), [1e-3, 1e-4] * 3
    for name in ("controlled[method=tc_monolithic]", "controlled_taylor", "controlled"):
        alone = [simulate(name, scenario, tolerance=tolerance) for tolerance in tolerances]
        assert at_once(lambda tolerance, name=name: simulate(name, scenario, tolerance=tolerance), tolerances) == alone


@pytest.mark.parametrize("name", ["tc_monolithic", "tc_gauss", "tc_taylor[order=8]", "richardson"])
def test_threads_that_share_a_stepper_take_turns(name, often):
    scenario = find_scenario("bound_equilibrium")
    step, lengths = tcbench.stepper(method_of(name), scenario), [0.01 * (k + 1) for k in range(THREADS)]

    def walk(h):
        z = scenario.z0
        for _ in range(50):
            z = step(z, h)
        return z.tobytes()

    alone = [walk(h) for h in lengths]
    assert at_once(walk, lengths) == alone


COLD = """
import sys
from concurrent.futures import ThreadPoolExecutor
import tcbench
from tcbench.plugins import find_scenario
sys.setswitchinterval(1e-5)
names = sys.argv[1:]

def bits(k):
    name = names[k % len(names)]
    scenario = find_scenario("chain[n=2]").replace(t_end=0.2)
    dt = {"tolerance": 1e-5} if name == "solve_ivp_radau" else {"dt": 0.1}
    return tcbench.simulate(name, scenario, **dt).z.tobytes().hex()

with ThreadPoolExecutor(6) as pool:
    for found in pool.map(bits, range(3 * len(names))):
        print(found)
"""


def test_threads_that_begin_with_nothing_loaded_or_compiled_give_the_same_bits(tmp_path):
    """Plugins are loaded, families make members, formulas are traced and compiled by threads that all want them."""
    names, scenario = ["tc_monolithic", "solve_ivp_radau"], find_scenario("chain[n=2]").replace(t_end=0.2)
    command = [sys.executable, "-c", COLD, *names]
    environment = os.environ | {"TCBENCH_CACHE_DIR": str(tmp_path)}
    found = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=True).stdout
    alone = [simulate(name, scenario, dt=0.1)[2].hex() for name in names]
    assert found.split() == alone * 3


# copies -------------------------------------------------------------------------------------------------------------

COPIES = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda item: pickle.loads(pickle.dumps(item))}


@pytest.mark.parametrize("case", [*CASES[: len(KINDS)], ("tc_monolithic", "net[nx=3,ny=3]")], ids=ids)
def test_copies_of_a_scenario_that_has_run_run_as_it_did(case):
    name, system = case
    scenario = find_scenario(system).replace(t_end=0.2)
    alone = simulate(name, scenario)
    if method_of(name).kind != "adaptive" and not method_of(name).memory:
        tcbench.stepper(method_of(name), scenario)(scenario.z0, 0.02)
    for copied in COPIES.values():
        again = copied(scenario)
        assert again == scenario and simulate(name, again) == alone
        with pytest.raises(ValueError, match="read-only"):
            again.z0[0] = 1.0
    assert simulate(name, scenario) == alone


@pytest.mark.parametrize("system", ["bound_equilibrium", "chain[n=4]", "net[nx=3,ny=3]"])
def test_a_copied_system_has_its_numbers_and_nothing_that_was_made_of_them(system):
    scenario = find_scenario(system).replace(t_end=0.2)
    simulate("tc_monolithic", scenario)
    fresh = set(vars(type(scenario.model)(**scenario.constants)))
    for name in ("deepcopy", "pickle"):
        again = COPIES[name](scenario.model)
        assert set(vars(again)) == fresh
        assert np.array_equal(again.vector_field(scenario.z0), scenario.model.vector_field(scenario.z0))
        with pytest.raises(ValueError, match="read-only"):
            again.masses[0] = 2.0


def test_a_stepper_that_is_copied_has_memory_of_its_own():
    scenario = find_scenario("bound_equilibrium")
    for name in ("tc_monolithic", "tc_gauss"):
        step = tcbench.stepper(name, scenario)
        expected = step(scenario.z0, 0.1).tobytes()
        for copied in COPIES.values():
            again = copied(step)
            assert again.iterations == 0 and again(scenario.z0, 0.1).tobytes() == expected


@pytest.mark.parametrize(
    "name",
    [
        "tc_monolithic",
        "tc_gauss",
        "tc_gauss[k=5]",
        "tc_taylor",
        "tc_taylor[order=8]",
        "gauss2",
        "scipy_dopri5",  # not dop853: SciPy's counts one evaluation more or less in two equal runs
        "tc_gonzalez",
        "controlled[method=tc_strang]",
    ],
)
def test_integrators_and_runs_can_be_pickled_and_copied(name):
    scenario = find_scenario("bound_equilibrium").replace(t_end=0.2)
    method, alone = find_integrator(name), simulate(name, scenario)
    run = tcbench.simulate(method, scenario, **settings(method))
    for copied in COPIES.values():
        assert told(tcbench.simulate(copied(method), scenario, **settings(method))) == alone
        assert told(copied(run)) == alone


def test_what_holds_addresses_is_no_data():
    work = find_integrator("tc_gauss").workspace(find_scenario("bound_equilibrium").model).work
    for copied in COPIES.values():
        with pytest.raises(TypeError, match="addresses"):
            copied(work)
    kernel = Kernel("def kernel(a, b, out):\n    out[0] = a[0]\n", 1)
    assert kernel.address and "address" not in vars(copy.deepcopy(kernel))


def test_constants_are_the_systems_own():
    """Not the caller's array, which may change after a kernel has read it."""
    scenario = find_scenario("bound_equilibrium")
    masses = np.array(scenario.constants["masses"])
    system = type(scenario.model)(**{**scenario.constants, "masses": masses})
    masses[:] = 7.0
    assert list(system.masses) == scenario.constants["masses"]
    for array in (system.masses, system.constant_values):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0


# one after the other ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_other_runs_in_between_and_runs_that_fail_change_nothing(name):
    first, second, third = variants("bound_equilibrium")
    method = method_of(name)
    alone = simulate(name, first)
    simulate(name, second)
    simulate(name, first, dt=0.05, tolerance=1e-3)
    stiff = first.replace(stiffness=[1e4, 1e4])
    tcbench.simulate(method, stiff, **settings(method, dt=0.25, tolerance=0.1))  # however it ends
    simulate(name, third)
    assert simulate(name, first) == alone


STEPPED = [name for name in KINDS if method_of(name).kind != "adaptive" and not method_of(name).memory]


@pytest.mark.parametrize("name", STEPPED)
def test_a_step_is_a_function_of_its_start_and_length(name):
    """Also from where the last one ended, after others and after those that fail."""
    scenario = find_scenario("bound_equilibrium")
    step, h = tcbench.stepper(method_of(name), scenario), 0.05
    z = scenario.z0
    for _ in range(10):
        z = step(z, h)
    on = step(z, h).tobytes()
    for disturbance in (lambda: step(scenario.z0, 2 * h), lambda: step(1e3 * scenario.z0, 1e6), lambda: None):
        with contextlib.suppress(ArithmeticError):
            disturbance()
        assert step(z, h).tobytes() == on
    assert tcbench.stepper(method_of(name), scenario)(z, h).tobytes() == on


@pytest.mark.parametrize("error", [KeyboardInterrupt, ArithmeticError, SystemExit])
@pytest.mark.parametrize("inner", ["tc_monolithic", "tc_gauss", "tc_taylor[order=8]"])
def test_a_run_that_was_interrupted_leaves_nothing_behind(inner, error):
    def stops(z, h, system):
        step = tcbench.stepper(inner, system)
        z1 = step(step(z, h / 2), h / 2)
        if z is not scenario.z0 and z[0] != scenario.z0[0]:
            raise error
        return z1

    scenario = find_scenario("bound_equilibrium").replace(t_end=0.5)
    alone = simulate(inner, scenario), simulate("controlled[method=tc_monolithic]", scenario, tolerance=1e-3)
    with contextlib.suppress(error):
        tcbench.simulate(Integrator(name="stops", order=1, step=stops), scenario, dt=0.1)
    again = simulate(inner, scenario), simulate("controlled[method=tc_monolithic]", scenario, tolerance=1e-3)
    assert again == alone


# workspaces ---------------------------------------------------------------------------------------------------------


def test_a_workspace_is_made_for_each_run_and_given_to_step_and_march():
    made = []

    def workspace(system):
        made.append([system.size])
        return made[-1]

    def step(z, h, system, held):
        held.append(h)
        return z + h * system.vector_field(z)

    def march(z, h, count, system, held):
        return [z := step(z, h, system, held) for _ in range(count)]

    scenario = find_scenario("bound_equilibrium").replace(t_end=0.1)
    for ways in ({}, {"march": march}):
        method = Integrator(name="held", order=1, step=step, workspace=workspace, **ways)
        for _ in range(2):
            tcbench.simulate(method, scenario, dt=0.01)
    assert made == [[scenario.model.size, *[0.01] * 10]] * 4


def test_a_multistep_method_has_its_workspace_behind_the_earlier_states():
    def step(z, h, system, before, held):
        held.append(len(before))
        return adams(z, h, system, before)

    held = []
    method = Integrator(name="held", order=2, memory=1, starter="tc_gauss", step=step, workspace=lambda system: held)
    tcbench.simulate(method, find_scenario("bound_equilibrium"), dt=0.01, t_end=0.05)
    assert held == [1] * 4


def test_a_workspace_without_a_step_is_refused():
    for ways in ({"flows": bdf2}, {"adaptive": lambda *a: None}):
        with pytest.raises(TcbenchError, match="workspace= without step="):
            Integrator(name="a", order=1, workspace=list, **ways)
    with pytest.raises(TcbenchError, match="workspace= is a function, not 3"):
        Integrator(name="a", order=1, step=richardson, workspace=3)
