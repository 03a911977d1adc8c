"""Of the pendulum the state of largest entropy is a rigid rotation: its values, by other ways."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tcbench
from tcbench.plugins import find_scenario
from tcbench.reference.certified import stored, stored_file
from tcbench.studies.equilibrium import exact_equilibrium, measure

NAME = "bound_equilibrium"
METHOD = tcbench.integrators()["tc_monolithic"]
KNOWN = {"exact_strain_a": 0.6481755, "exact_strain_b": 0.1650492, "exact_temperature": 311.936511,
         "exact_rate": 0.278229725, "exact_entropy": 0.5528169814}  # fmt: skip
E_BOUND, J_BOUND = 173.03573584848614507, 18.0


def told(name=NAME, **changes):
    scenario = tcbench.scenarios()[name].replace(**changes)
    return measure(METHOD, scenario.replace(t_end=scenario.dt), {"dt": scenario.dt})["summary"]


@pytest.fixture(scope="module")
def bound():
    return told()


def test_bound_equilibrium_has_the_published_values(bound):
    """docs/truth.md prints seven to ten digits: agreement to half a unit of the last one."""
    assert {name: bound[name] for name in KNOWN} == pytest.approx(KNOWN, rel=0, abs=5e-7)
    assert bound["exact_rate"] == pytest.approx(KNOWN["exact_rate"], abs=1e-9)
    assert bound["exact_entropy"] == pytest.approx(KNOWN["exact_entropy"], abs=1e-10)


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


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-0.3, 0.3), min_size=2, max_size=2), st.floats(-0.5, 0.5), st.floats(-20, 20))
def test_no_state_of_the_same_energy_and_momentum_has_more_entropy(bound, stretch, radial, heat):
    """Random neighbours at the same E and J: strains, radial motion, unequal temperatures cost S."""
    c = tcbench.scenarios()[NAME].constants
    L = np.array([KNOWN["exact_strain_a"], KNOWN["exact_strain_b"]]) + np.array(stretch)
    r1, r2 = np.array(c["natural_lengths"]) * np.exp(L)
    w = J_BOUND / (r1**2 + 2 * (r1 + r2) ** 2)
    kinetic = 0.5 * J_BOUND * w + radial**2 / 2
    elastic = np.sum(np.array(c["stiffness"]) / 2 * L**2 + 60 * L)
    mean = 300 + (E_BOUND - kinetic - elastic) / 10
    theta = mean + np.array([heat, -heat])
    S = np.sum(0.2 * L + 5 * np.log(theta / 300))
    assert bound["exact_entropy"] + 1e-13 >= S


def test_certified_trajectory_approaches_from_below():
    model = tcbench.scenarios()[NAME].model
    S = np.array([float(model.entropy(z)) for z in stored(NAME).states])
    gap = exact_equilibrium(tcbench.scenarios()[NAME]).entropy - S
    assert np.all(gap > 0) and np.all(np.diff(gap) < 0)
    assert gap[-1] < 1e-4


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


@pytest.mark.parametrize(("name", "strain_a"), [("short_term", 5.91153981), ("stiff_spring", 6.52843676)])
def test_far_away_strains_are_known_as_far_as_entropy_tells_them(name, strain_a):
    """S is flat at its top: its values fix the strains only to about the square root of round-off."""
    assert told(name)["exact_strain_a"] == pytest.approx(strain_a, abs=5e-6)


@pytest.mark.parametrize(
    ("seed", "entropy"),
    [(8, -0.10602117133763), (37, -3.00517661615519), (2, 1.43505205840692)],
)
def test_the_highest_of_several_tops_is_found_and_the_end_of_a_flat_valley(seed, entropy):
    """Random pendulums, of which a climb from the start alone ends at a lower top, or in a valley where a turn of one
    spring changes S by 1e-12 a step. (Values by a grid over the strains, and four equations for their root.)"""
    assert exact_equilibrium(find_scenario(f"random[seed={seed}]")).entropy == pytest.approx(entropy, abs=5e-10)


def test_a_wrong_constant_is_noticed():
    """Broken on purpose: with another stiffness the published values no longer come out."""
    assert abs(told(stiffness=(10.0, 21.0))["exact_entropy"] - KNOWN["exact_entropy"]) > 1e-6


def test_sign_of_rotation_follows_angular_momentum(bound):
    scenario = tcbench.scenarios()[NAME]
    mirrored = told(momenta=[-p for p in scenario.momenta])
    assert mirrored["exact_rate"] == pytest.approx(-bound["exact_rate"], rel=1e-12)
    assert mirrored["exact_strain_a"] == pytest.approx(bound["exact_strain_a"], abs=1e-12)
