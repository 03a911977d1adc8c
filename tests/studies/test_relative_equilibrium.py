"""The exact relative equilibrium solves the balance equations and is the state of largest entropy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tcbench.reference.certified import stored, stored_file
from tcbench.studies.relative_equilibrium import RelativeEquilibrium, gaps, measures, relative_equilibrium

BOUND = stored_file()["scenarios"]["bound_equilibrium"]["constants"]
E_BOUND, J_BOUND = 173.03573584848614507, 18.0


@pytest.fixture(scope="module")
def bound() -> RelativeEquilibrium:
    return relative_equilibrium(BOUND, E_BOUND, J_BOUND)


def rigid_rotation(eq: RelativeEquilibrium, constants, angle: float = 0.7) -> np.ndarray:
    """State (10,) of the rigid rotation, turned by `angle`."""
    r1, r2 = np.array(constants["natural_lengths"]) * np.exp(eq.strains)
    e, n = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    m1, m2 = constants["masses"]
    theta_ref, beta, c0 = (constants[k] for k in ("reference_temperature", "coupling", "heat_capacity"))
    s = beta * eq.strains + c0 * np.log(eq.temperature / theta_ref)
    return np.concatenate([r1 * e, (r1 + r2) * e, m1 * eq.rate * r1 * n, m2 * eq.rate * (r1 + r2) * n, s])


def test_bound_equilibrium_has_the_published_values(bound):
    """PHYSICS section 5 prints seven to ten digits: agreement to half a unit of the last one."""
    assert bound.exists and not bound.distant
    assert bound.strains == pytest.approx([0.6481755, 0.1650492], abs=1e-7)
    assert bound.temperature == pytest.approx(311.936511, abs=5e-7)
    assert bound.rate == pytest.approx(0.278229725, abs=1e-9)
    assert bound.entropy == pytest.approx(0.5528169814, abs=1e-10)


def test_two_computations_agree(bound):
    assert bound.residual < 1e-14
    assert bound.maximum_gap < 1e-7


def test_values_agree_with_forty_digit_arithmetic(bound):
    """The four equations once more, in mpmath by its own root finder: 1e-12 covers conditioning in double."""
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
        found = [*bound.strains, bound.temperature, bound.rate]
        assert np.allclose(found, [float(x) for x in root], rtol=1e-12, atol=0)


def test_rigid_rotation_has_no_gap(bound):
    z = np.array([rigid_rotation(bound, BOUND, angle) for angle in (0.0, 0.7, 3.0)])
    for name, value in gaps(z, bound, BOUND).items():
        assert np.max(np.abs(value)) < 1e-11, name


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-0.3, 0.3), min_size=2, max_size=2), st.floats(-0.5, 0.5), st.floats(-20, 20))
def test_no_state_of_the_same_energy_and_momentum_has_more_entropy(stretch, radial, heat):
    """Random neighbours at the same E and J: strains, radial motion, unequal temperatures cost S."""
    bound = relative_equilibrium(BOUND, E_BOUND, J_BOUND)
    L = bound.strains + np.array(stretch)
    r1, r2 = np.array(BOUND["natural_lengths"]) * np.exp(L)
    w = J_BOUND / (r1**2 + 2 * (r1 + r2) ** 2)
    kinetic = 0.5 * J_BOUND * w + radial**2 / 2
    elastic = np.sum(np.array(BOUND["stiffness"]) / 2 * L**2 + 60 * L)
    mean = 300 + (E_BOUND - kinetic - elastic) / 10
    theta = mean + np.array([heat, -heat])
    S = np.sum(0.2 * L + 5 * np.log(theta / 300))
    assert bound.entropy + 1e-13 >= S


def test_certified_trajectory_approaches_from_below(bound):
    reference = stored("bound_equilibrium")
    gap = gaps(reference.states, bound, BOUND)["entropy_gap"]
    assert np.all(gap > 0) and np.all(np.diff(gap) < 0)
    assert gap[-1] < 1e-4


def test_printed_data_have_only_a_distant_equilibrium():
    """The paper sees a relative equilibrium by t = 1500; S = 2.8034 there, and 3.0031 at the exact one."""
    record = stored_file()["scenarios"]["relative_equilibrium"]
    constants = record["constants"]
    eq = relative_equilibrium(constants, float(record["E0"]), float(record["J0"]))
    assert eq.exists and eq.distant and "growth" in eq.note
    assert eq.entropy == pytest.approx(3.0031074442, abs=1e-9)
    state = measures(stored("relative_equilibrium").states, constants)
    assert state["strains"][-1] == pytest.approx([8.54, 9.33], abs=0.01)
    assert state["entropy"][-1] == pytest.approx(2.8034, abs=5e-5)


def test_too_little_energy_is_reported_not_invented():
    eq = relative_equilibrium(BOUND, -1e5, 18.0)
    assert not eq.exists and np.isnan(eq.entropy) and "energy" in eq.note
    assert np.all(np.isnan(gaps(np.ones((2, 10)) * np.arange(1, 11), eq, BOUND)["strain_gap"]))


def test_a_wrong_constant_is_noticed():
    """Broken on purpose: with another stiffness the published values no longer come out."""
    eq = relative_equilibrium({**BOUND, "stiffness": (10.0, 20.1)}, E_BOUND, J_BOUND)
    assert abs(eq.entropy - 0.5528169814) > 1e-6


def test_sign_of_rotation_follows_angular_momentum(bound):
    mirrored = relative_equilibrium(BOUND, E_BOUND, -J_BOUND)
    assert mirrored.rate == pytest.approx(-bound.rate, rel=1e-12)
    assert mirrored.strains == pytest.approx(bound.strains, abs=1e-12)
