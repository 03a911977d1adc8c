"""The chain: the pendulum is n = 2, the banded step is the traced one, and its cost is linear in n."""

import numpy as np
import pytest

import tcbench
from tcbench import TcbenchError, banded
from tcbench.chain import chain, chain_system

PENDULUM = tcbench.scenarios()["bound_equilibrium"]


def test_two_masses_are_the_pendulum():
    data = {name: getattr(PENDULUM, name) for name in ("positions", "momenta", "temperatures")}
    scene = chain(2, **PENDULUM.constants, **data, t_end=6.0, dt=0.3)
    one, two = tcbench.simulate("tc_strang", scene), tcbench.simulate("tc_strang", PENDULUM, t_end=6.0)
    assert np.allclose(one.z, two.z, rtol=1e-12, atol=1e-12)
    assert np.allclose(one.angular_momentum, two.angular_momentum, rtol=1e-14)


@pytest.mark.parametrize("n", [2, 3])
def test_the_banded_step_is_the_traced_one(n):
    scene = chain(n, t_end=5.0)
    traced, fast = tcbench.simulate("tc_monolithic", scene, dt=0.1), banded.march(scene, 0.1, 50)
    assert np.allclose(fast.z, traced.z, rtol=1e-12, atol=1e-12)
    assert np.allclose(fast.energy, traced.energy, rtol=1e-14) and np.allclose(fast.entropy, traced.entropy, atol=1e-13)
    assert np.array_equal(tcbench.simulate(banded.TC_BANDED, scene, dt=0.1).z, fast.z)


def test_the_banded_jacobian_agrees_with_differences():
    n, rng = 6, np.random.default_rng(1)
    scene = chain(n, masses=np.linspace(1, 2, n), stiffness=np.linspace(5, 20, n))
    model, z = scene.model, scene.model.state(scene.z0)
    r0, p = model.springs(z.q), np.asarray(z.p).reshape(n, 2)

    def system(u):
        dq, ds = u.reshape(n, 3)[:, :2], u.reshape(n, 3)[:, 2]
        dr = np.diff(dq, axis=0, prepend=np.zeros((1, 2)))
        return banded._system(model, p, np.asarray(z.s), 0.1, r0, dr, dq, ds)

    u = 0.05 * rng.normal(size=3 * n)
    diagonals, found = system(u)[1], np.zeros((3 * n, 3 * n))
    for i, j in np.ndindex(found.shape):
        if -banded.ABOVE <= i - j <= banded.BELOW:
            found[i, j] = diagonals[banded.ABOVE + i - j, j]
    steps = 1e-6 * np.eye(3 * n)
    differences = np.stack([(system(u + e)[0] - system(u - e)[0]).ravel() / 2e-6 for e in steps], axis=1)
    assert np.abs(found - differences).max() < 1e-8 * np.abs(found).max()


def test_the_laws_hold_at_every_length():
    for n in (10, 1000):
        run = banded.march(chain(n), 0.2, 20)
        assert np.abs(run.energy - run.energy[0]).max() < 1e-13 * abs(run.energy[0])
        assert np.diff(run.entropy).min() > -1e-13 * np.abs(run.entropy).max()
        q, p = run.z[:, : 2 * n].reshape(-1, n, 2), run.z[:, 2 * n : 4 * n].reshape(-1, n, 2)
        J = (q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]).sum(axis=1)
        assert np.abs(J - J[0]).max() < 1e-12 * np.abs(q[0] * p[0][:, ::-1]).sum()


def test_cost_is_linear_in_the_number_of_masses():
    times = {n: min(banded.march(chain(n), 0.1, 3).us_per_step for _ in range(3)) for n in (2500, 10_000)}
    assert times[10_000] < 8 * times[2500]  # 4 if nothing else ran; a dense factorisation would give 64


def test_what_is_no_chain_is_refused_with_a_sentence():
    with pytest.raises(TcbenchError, match="written for chains"):
        banded.march(PENDULUM, 0.1, 1)
    with pytest.raises(TcbenchError, match="at least 2"):
        chain(1)
    with pytest.raises(TcbenchError, match="take a smaller dt"):
        banded.march(chain(5), 1e6, 1)


def test_workers_find_the_class_of_a_chain_by_name(tmp_path):
    results = tcbench.run(["tc_monolithic"], [chain(3, t_end=1.0)], ["conservation"], output=tmp_path, dt=[0.1])
    assert list(results.tables["conservation"]["status"]) == ["ok"]
    import tcbench.chain as module

    assert module.Chain3 is chain_system(3) and not hasattr(module, "Chainx")
