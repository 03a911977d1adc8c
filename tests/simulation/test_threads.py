"""Threads that run at once, and what another keeps on a system meanwhile, change no bit."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest

import tcbench
from tcbench.plugins import find_scenario
from tcbench.systems import traced
from tcbench.systems.over_spaces import OverSpaces

from ..helpers import networks
from ..helpers.every_kind import CASES, ids, method_of, simulate, variants

THREADS = 6


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


@pytest.mark.parametrize("case", CASES, ids=ids)
def test_threads_give_the_bits_of_one_run_after_the_other(case, often):
    """The threads come first: what is traced and compiled for a system is so by several of them."""
    name, system = case
    scenarios = variants(system) * 2
    found = at_once(lambda scenario: simulate(name, scenario), scenarios)
    alone = [simulate(name, scenario) for scenario in variants(system)]
    assert alone[0][0] == "ok" and len({run[2] for run in alone[1:]}) == 2
    assert found == alone * 2


def test_what_stands_for_a_net_is_whole_before_another_thread_can_take_it(monkeypatch):
    """It had its mesh, and not yet what it is traced on: another thread then branched on symbols."""

    class Fresh(networks.Row):
        name = "fresh"

    found, make = [], OverSpaces._by_arrays

    def watched(system, *given):
        found.append(["mesh" in vars(known) for known in traced._SYMBOLIC.values() if type(known) is Fresh])
        found.append(["symbolic" in vars(system)])
        return make(system, *given)

    monkeypatch.setattr(OverSpaces, "_by_arrays", watched)
    assert networks.row(Fresh).model.n_temperatures == networks.N and found == [[False], [False]]


@pytest.mark.parametrize("name", ["tc_monolithic", "tc_gauss", "tc_taylor[order=8]"])
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


@pytest.mark.thorough
def test_threads_that_begin_with_nothing_loaded_or_compiled_give_the_same_bits(tmp_path):
    """Plugins are loaded, families make members, formulas are traced and compiled by threads that all want them."""
    names, scenario = ["tc_monolithic", "solve_ivp_radau"], find_scenario("chain[n=2]").replace(t_end=0.2)
    command = [sys.executable, "-c", COLD, *names]
    environment = os.environ | {"TCBENCH_CACHE_DIR": str(tmp_path)}
    found = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=True).stdout
    alone = [simulate(name, scenario, dt=0.1)[2].hex() for name in names]
    assert found.split() == alone * 3
