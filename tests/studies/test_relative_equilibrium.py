"""Of the pendulum the state of largest entropy is a rigid rotation: its values, by other ways."""

import numpy as np
import pytest

import tcbench
from tcbench.plugins import find_scenario
from tcbench.reference.certified import stored, stored_file
from tcbench.studies.equilibrium import exact_equilibrium, measure

NAME = "bound_equilibrium"
METHOD = tcbench.integrators()["tc_monolithic"]
E_BOUND, J_BOUND = 173.03573584848614507, 18.0


def told(name=NAME, **changes):
    scenario = tcbench.scenarios()[name].replace(**changes)
    return measure(METHOD, scenario.replace(t_end=scenario.dt), {"dt": scenario.dt})["summary"]


@pytest.fixture(scope="module")
def bound():
    return told()


def test_values_agree_with_forty_digit_arithmetic(bound):
    """The balance of momenta in rigid rotation (Romero (2009), section 4), in mpmath by its own root finder, which
    knows nothing of a largest entropy: 1e-12 covers conditioning in double."""
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(40):
        E, J = (mpmath.mpf(stored_file()["scenarios"]["bound_equilibrium"][k]) for k in ("E0", "J0"))
        beta = mpmath.mpf(1) / 5

        def equations(La, Lb, T, w):
            r1, r2 = 2 * mpmath.e**La, mpmath.e**Lb
            fa, fb = (10 * La - beta * (T - 300)) / r1, (20 * Lb - beta * (T - 300)) / r2
            inertia = r1**2 + 2 * (r1 + r2) ** 2
            energy = inertia * w**2 / 2 + 5 * La**2 + 10 * Lb**2 + 60 * (La + Lb) + 10 * (T - 300)
            return [fb - 2 * w**2 * (r1 + r2), fa - fb - w**2 * r1, inertia * w - J, energy - E]

        root = mpmath.findroot(equations, (0.65, 0.16, 312, 0.28))
        found = [bound[f"exact_{name}"] for name in ("strain_a", "strain_b", "temperature", "rate")]
        assert np.allclose(found, [float(x) for x in root], rtol=1e-12, atol=0)


def test_certified_trajectory_approaches_from_below():
    model = tcbench.scenarios()[NAME].model
    S = np.array([float(model.entropy(z)) for z in stored(NAME).states])
    gap = exact_equilibrium(tcbench.scenarios()[NAME]).entropy - S
    assert np.all(gap > 0) and np.all(np.diff(gap) < 0)
    assert gap[-1] < 1e-4


@pytest.mark.thorough
def test_printed_data_have_only_a_distant_equilibrium():
    """The paper sees a relative equilibrium by t = 1500; S = 2.8034 there, and 3.0031 at the exact one, where a spring
    is 3e5 natural lengths long. (The four equations, solved by their own root finder, gave these digits.)"""
    found = told("relative_equilibrium")
    assert found["equilibrium"] == "distant" and np.isnan(found["entropy_gap"])
    assert found["exact_entropy"] == pytest.approx(3.0031074442125245, abs=1e-13)
    assert [found["exact_strain_a"], found["exact_strain_b"]] == pytest.approx([12.69851812, 1.26985181], abs=1e-8)
    assert found["exact_rate"] == pytest.approx(1.5250320958862635e-11, rel=1e-8)
    z = stored("relative_equilibrium").states[-1]
    model = tcbench.scenarios()["relative_equilibrium"].model
    assert model.log_strain(model.shape(z[:4])) == pytest.approx([8.54, 9.33], abs=0.01)
    assert float(model.entropy(z)) == pytest.approx(2.8034, abs=5e-5)


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "entropy"), [(8, -0.10602117133763), (37, -3.00517661615519)])
def test_the_highest_of_several_tops_is_found_and_the_end_of_a_flat_valley(seed, entropy):
    """Random pendulums, of which a climb from the start alone ends at a lower top, or in a valley where a turn of one
    spring changes S by 1e-12 a step. (Values by a grid over the strains, and four equations for their root.)"""
    assert exact_equilibrium(find_scenario(f"random[seed={seed}]")).entropy == pytest.approx(entropy, abs=5e-10)
