"""The solvers that a user would pick instead: each agrees with the reference, on both systems, and counts its work."""

import subprocess
import sys

import numpy as np
import pytest
from spread import spread
from tcbench_plugins import peers_pydiffsol
from tcbench_plugins.chain.chain import chain

import tcbench
from tcbench import TcbenchError
from tcbench.reference.lookup import reference_for
from tcbench.systems.right_hand_side import Field, expressions

PEERS = [i.name for i in tcbench.integrators().values() if "peer" in i.tags and not i.lacks]
LOOSE = {
    "cvode": 1e-6,
    "pydiffsol": 1e-6,
    "diffrax": 1e-7,
    "solve_ivp_bdf": 1e-6,
    "scipy_odeint": 1e-7,
    "solve_ivp_lsoda": 1e-7,
}


@pytest.mark.parametrize(
    ("peer", "scenario"), spread(PEERS, ["short_term", "gas_containers"], core=("cvode", "heyoka", "pydiffsol"))
)
def test_a_peer_agrees_with_the_reference_at_a_tight_tolerance(peer, scenario):
    scenario = tcbench.scenarios()[scenario].replace(t_end=1.0)
    exact = reference_for(scenario, [1.0]).states[0].astype(float)
    method = tcbench.integrators()[peer]
    states, counts = method.adaptive(scenario.model, scenario.z0.copy(), np.array([0.0, 1.0]), 1e-11, 1e-11)
    assert states.shape == (2, scenario.model.size) and np.array_equal(states[0], scenario.z0)
    assert np.max(np.abs(states[-1] - exact) / np.maximum(1, np.abs(exact))) < LOOSE.get(peer, 1e-8)
    assert all(value > 0 for value in counts.values()) and ("steps" in counts or peer == "pydiffsol")
    run = tcbench.simulate(peer, scenario, tolerance=1e-8)
    best = tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=1e-12)
    assert run.ok and len(run.z) == 201 and np.abs(run.z - best.z).max() < 1e-5  # at the times asked for


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")  # trial steps of an explicit solver
@pytest.mark.parametrize("peer", [p for p in PEERS if p not in ("heyoka", "diffrax", "pydiffsol")])
def test_peers_run_on_large_stiff_systems(peer):
    """Where a dense Jacobian is none that one could have: conduction a hundred times as fast."""
    scenario = chain(41, conductivity=1e3)
    best = tcbench.simulate("solve_ivp_radau", scenario, t_end=0.02, tolerance=1e-9, record_every=None)
    run = tcbench.simulate(peer, scenario, t_end=0.02, tolerance=1e-7, record_every=None)
    assert run.ok, run.failure
    assert np.abs(run.z[-1] - best.z[-1]).max() < 1e-4


@pytest.mark.parametrize("peer", ["heyoka", "pydiffsol"])
def test_peers_say_that_they_compile_number_by_number(peer):
    """pydiffsol's compiler took 12 GB of 800 numbers, and two such cells ran at once."""
    pytest.importorskip(peer)
    with pytest.raises(TcbenchError, match=f"{peer} compiles a formula for each of the 205 numbers"):
        tcbench.simulate(peer, chain(41))


def test_a_failed_solver_is_a_row():
    scenario = tcbench.scenarios()["stiff_spring"]
    run = tcbench.simulate("scipy_dop853", scenario.replace(conductivity=1e7, t_end=5.0, dt=0.1), tolerance=1e-3)
    assert run.status == "nonconverged" and "dop853" in run.failure


def test_a_lost_run_of_an_implicit_solver_ends_as_scipy_ends_it():
    run = tcbench.simulate("solve_ivp_bdf", "gas_containers", tolerance=0.1)
    assert run.status == "nonconverged" and "solve_ivp BDF: array must not contain infs or NaNs" in run.failure


def test_the_field_has_the_systems_rate_and_jacobian():
    scenario = tcbench.scenarios()["short_term"]
    field, z, model = Field(scenario.model), scenario.z0.copy(), scenario.model
    out = np.empty(10)
    field.into(0.0, z, out)
    for rate in (field.shared(0.0, z), field.rate(0.0, z), out):
        assert np.array_equal(rate, model.vector_field(z))
    assert np.array_equal(field.jacobian(0.0, z), model.jacobian(z)) and field.evaluations == 3
    numpy_only = {n: getattr(np, n) for n in ("exp", "log", "sqrt", "log1p", "expm1")}
    assert np.allclose(expressions(model, list(z), list(model.constant_values), numpy_only), model.vector_field(z))


ABSENT = """
import importlib.metadata, importlib.util
find, known = importlib.util.find_spec, importlib.metadata.version
def version(name):
    if name in ("heyoka", "scikit-sundae", "diffrax", "jax", "pydiffsol"):
        raise importlib.metadata.PackageNotFoundError(name)
    return known(name)
importlib.metadata.version = version
absent = ("heyoka", "sksundae", "diffrax", "jax", "pydiffsol")
importlib.util.find_spec = lambda name, *a: None if name in absent else find(name, *a)
import tcbench
from tcbench.plugins import registry
from tcbench.studies.work_precision import plan
found = tcbench.integrators()
assert not registry().broken
for name in ("cvode", "heyoka", "diffrax", "pydiffsol"):
    assert "pip install" in found[name].lacks and not found[name].suits(tcbench.scenarios()["short_term"].model)
scenario = tcbench.scenarios()["short_term"]
peers = {"cvode", "heyoka", "diffrax", "pydiffsol"}
assert {i.name for i, _, _ in plan(list(found.values()), [scenario], {})} == set(found) - peers
try:
    tcbench.simulate("cvode", "short_term")
except tcbench.TcbenchError as error:
    print(error)
"""


def test_absent_packages_are_listed_as_such_and_left_out():
    done = subprocess.run([sys.executable, "-c", ABSENT], capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    assert "pip install scikit-sundae" in done.stdout
    assert issubclass(TcbenchError, Exception)


@pytest.mark.parametrize(
    ("told", "kind"), [("ODE solver error: too many failures", ArithmeticError), ("no", RuntimeError)]
)
def test_a_solver_of_diffsol_that_gives_up_is_no_fault(monkeypatch, told, kind):
    """It is a result, as of Newton's method; what else goes wrong is one."""
    pytest.importorskip("pydiffsol")
    system, z0 = (x := tcbench.scenarios()["reaction"]).model, x.z0

    class Fails:
        def solve_dense(self, *_):
            raise RuntimeError(told)

    monkeypatch.setattr(peers_pydiffsol, "_FREE", {(system.structure, "bdf", system.unit_sizes is None): [Fails()]})
    with pytest.raises(kind, match=told):
        tcbench.integrators()["pydiffsol"].adaptive(system, z0, np.array([0.0, 1.0]), 1e-6, 1e-6)
