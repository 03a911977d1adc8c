"""The pendulum behind `System`: exact initial data, derivatives, the discrete gradient, GENERIC structure."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from states import admissible_states

import tcbench

mp.mp.dps = 50
MODEL = tcbench.scenarios()["short_term"].model
ORACLE = {  # E, S, J at t = 0 to 20 digits (160- and 220-bit Taylor series)
    "short_term": (421.64110579977235469, 1.243727879682908186, 2.0),
    "long_term": (910.46366607127652993, 2.5829576497099948376, 19.6),
    "bound_equilibrium": (173.03573584848614507, 0.53207724634128019747, 18.0),
}


@pytest.mark.parametrize("name", ORACLE)
def test_initial_energy_entropy_and_angular_momentum_are_exact(name):
    scenario = tcbench.scenarios()[name]
    z0, model = scenario.z0, scenario.model
    measured = (model.energy(z0), model.entropy(z0), model.momenta(z0)[0])
    # the data are decimals rounded to double: a few units of round-off are left
    assert np.allclose(measured, ORACLE[name], rtol=1e-14, atol=0)


def complex_step(function, z, step=1e-30):
    """Exact derivative of an analytic plain-numpy function of one state, shape (..., n)."""
    columns = [function(z + 1j * step * e).imag / step for e in np.eye(len(z))]
    return np.stack(columns, axis=-1)


def plain_energy(z):
    """E written out from (43) by hand, plain numpy: works on complex numbers."""
    m = MODEL
    r = [z[:2], z[2:4] - z[:2]]
    E = (z[4] ** 2 + z[5] ** 2) / (2 * m.masses[0]) + (z[6] ** 2 + z[7] ** 2) / (2 * m.masses[1])
    for i in range(2):
        L = 0.5 * np.log(r[i][0] ** 2 + r[i][1] ** 2) - np.log(m.natural_lengths[i])
        E = E + m.stiffness[i] / 2 * L**2 + m.coupling * m.reference_temperature * L
        E = E + m.heat_capacity * m.reference_temperature * (np.exp((z[8 + i] - m.coupling * L) / m.heat_capacity) - 1)
    return E


def plain_field(z):
    """dz/dt from (1) and (22), with the gradient by complex step of the energy where z is real."""
    m = MODEL
    r = [z[:2], z[2:4] - z[:2]]
    force, theta = [], []
    for i in range(2):
        pi = r[i][0] ** 2 + r[i][1] ** 2
        L = 0.5 * np.log(pi) - np.log(m.natural_lengths[i])
        t = m.reference_temperature * np.exp((z[8 + i] - m.coupling * L) / m.heat_capacity)
        force.append((m.stiffness[i] * L - m.coupling * (t - m.reference_temperature)) / pi * r[i])
        theta.append(t)
    ds = [m.conductivity * (theta[1] / theta[0] - 1), m.conductivity * (theta[0] / theta[1] - 1)]
    return np.concatenate([z[4:6] / m.masses[0], z[6:8] / m.masses[1], force[1] - force[0], -force[1], ds])


@settings(max_examples=25)
@given(admissible_states())
def test_energy_and_its_gradient_agree_with_the_printed_formula_and_complex_step(y):
    z = np.asarray(MODEL.entropy_variables(y))
    assert MODEL.energy(z) == pytest.approx(plain_energy(z), rel=1e-13)
    assert np.allclose(MODEL.gradient(z), complex_step(plain_energy, z), rtol=1e-11, atol=1e-11)


@settings(max_examples=25)
@given(admissible_states())
def test_vector_field_and_jacobian_agree_with_the_printed_equations_and_complex_step(y):
    z = np.asarray(MODEL.entropy_variables(y))
    assert np.allclose(MODEL.vector_field(z), plain_field(z), rtol=1e-11, atol=1e-10)
    scale = np.abs(MODEL.jacobian(z)).max()
    assert np.allclose(MODEL.jacobian(z), complex_step(plain_field, z), rtol=1e-10, atol=1e-12 * scale)


@settings(max_examples=25)
@given(admissible_states())
def test_change_to_temperature_variables_and_back_is_the_identity(y):
    z = MODEL.entropy_variables(y)
    assert np.allclose(MODEL.temperature_variables(z), y, rtol=1e-13, atol=1e-13)
    step = 1e-6
    field = np.asarray(MODEL.vector_field(z))
    change = MODEL.temperature_variables(z + step * field) - MODEL.temperature_variables(z - step * field)
    scale = np.abs(field).max()  # central differences: error of order (step * scale)^2
    assert np.allclose(MODEL.temperature_field(y), change / (2 * step), rtol=1e-6, atol=1e-5 * max(1.0, scale))


@pytest.mark.parametrize("scenario", ["short_term", "net[nx=4,ny=4]"])
def test_a_temperature_is_not_taken_for_an_entropy(scenario):
    """In a formula each state has the name of its own thermal variable, and the system takes entropies."""

    def method(rates, variables="temperature"):
        def formula(z0, z1, h, system):
            return z1 - z0 - h * rates((z0 + z1) / 2, system)

        return tcbench.Integrator(name="taken", order=2, flows=tcbench.Flow(formula, variables=variables))

    for wrong, told in (
        (method(lambda z, _: z.s), "no variable 's'; its variables: q, p, theta"),
        (method(lambda z, system: system.state(z).s), "no variable 's'; its variables: q, p, theta"),
        (method(lambda z, system: system.state(z).s, "energy"), "no variable 's'; its variables: q, p, u"),
        (method(lambda z, _: z.theta, "entropy"), "no variable 'theta'; its variables: q, p, s"),
        (method(lambda z, system: system.vector_field(z)), "gets a state that has 'theta'"),
        (method(lambda z, system: system.vector_field(z), "energy"), "gets a state that has 'u'"),
    ):
        with pytest.raises(tcbench.TcbenchError, match=told):
            tcbench.simulate(wrong, scenario, dt=0.1, t_end=0.1)
    right = method(lambda z, system: system.temperature_field(z))
    rate = tcbench.simulate("midpoint_temperature[reading=rate]", scenario, dt=0.1, t_end=0.1)
    assert np.array_equal(tcbench.simulate(right, scenario, dt=0.1, t_end=0.1).z, rate.z)


@settings(max_examples=25)
@given(admissible_states(), admissible_states())
def test_directionality_discrete_gradient_reproduces_energy_differences(y0, y1):
    z0, z1 = np.asarray(MODEL.entropy_variables(y0)), np.asarray(MODEL.entropy_variables(y1))
    work = np.asarray(MODEL.discrete_gradient(z0, z1)) @ (z1 - z0)  # eq. (8)
    energies = MODEL.energy(z0), MODEL.energy(z1)
    parts = np.abs(np.asarray(MODEL.discrete_gradient(z0, z1)) * (z1 - z0)).sum() + np.abs(energies).sum()
    assert work == pytest.approx(energies[1] - energies[0], abs=1e-14 * parts)


def plain_quotients(z0, z1, number=float, log=np.log, exp=np.exp):
    """D_pi e and D_s e of both springs as printed, (31)-(32), in any arithmetic."""
    m, result = MODEL, []
    for i in range(2):

        def pi(z, i=i):
            r = [z[2 * i + k] - (z[k] if i else 0) for k in range(2)]
            return r[0] * r[0] + r[1] * r[1]

        def e(p, s, i=i):
            C, l0, beta, ref, c0 = (
                number(v)
                for v in (
                    m.stiffness[i], m.natural_lengths[i], m.coupling, m.reference_temperature, m.heat_capacity,
                )
            )  # fmt: skip
            L = log(p) / 2 - log(l0)
            return C / 2 * L * L + beta * ref * L + c0 * ref * (exp((s - beta * L) / c0) - 1)

        p0, p1, s0, s1 = pi(z0), pi(z1), z0[8 + i], z1[8 + i]
        assume(p0 != p1 and s0 != s1)  # the printed quotients are 0/0 there; the limit has a test of its own
        d_pi = (e(p1, s1) - e(p0, s1) + e(p1, s0) - e(p0, s0)) / (2 * (p1 - p0))
        d_s = (e(p1, s1) - e(p1, s0) + e(p0, s1) - e(p0, s0)) / (2 * (s1 - s0))
        result.append((d_pi, d_s))
    return result


def assembled(z0, z1, slopes):
    """The discrete gradient from the two quotients: (27)-(30)."""
    mid = [(a + b) / 2 for a, b in zip(z0, z1, strict=True)]
    (a, theta_a), (b, theta_b) = slopes
    ra, rb = mid[:2], [mid[2] - mid[0], mid[3] - mid[1]]
    q1 = [2 * a * ra[k] - 2 * b * rb[k] for k in range(2)]
    q2 = [2 * b * rb[k] for k in range(2)]
    p = [mid[4 + k] / (1 if k < 2 else 2) for k in range(4)]
    return np.array([float(v) for v in [*q1, *q2, *p, theta_a, theta_b]])


@settings(max_examples=25)
@given(admissible_states(), admissible_states())
def test_discrete_gradient_agrees_with_plain_quotients_at_large_increments(y0, y1):
    z0, z1 = np.asarray(MODEL.entropy_variables(y0)), np.asarray(MODEL.entropy_variables(y1))
    exact = plain_quotients([mp.mpf(v) for v in z0], [mp.mpf(v) for v in z1], mp.mpf, mp.log, mp.exp)
    assert np.allclose(MODEL.discrete_gradient(z0, z1), assembled(z0, z1, exact), rtol=2e-13, atol=2e-13)


DIRECTIONS = st.lists(
    st.builds(lambda size, sign: size * sign, st.floats(0.01, 1), st.sampled_from([-1, 1])), min_size=10, max_size=10
)


@settings(max_examples=25)
@given(admissible_states(), DIRECTIONS, st.integers(1, 14))
def test_discrete_gradient_keeps_its_digits_down_to_increments_of_1e_14(y0, direction, exponent):
    z0 = np.asarray(MODEL.entropy_variables(y0))
    z1 = z0 + 10.0**-exponent * np.array(direction)
    exact = plain_quotients([mp.mpf(v) for v in z0], [mp.mpf(v) for v in z1], mp.mpf, mp.log, mp.exp)
    expected = assembled(z0, z1, exact)
    # stress is a difference of terms of size C L^2 and beta theta_ref: those set the round-off
    assert np.allclose(MODEL.discrete_gradient(z0, z1), expected, rtol=1e-13, atol=1e-12)


@settings(max_examples=25)
@given(admissible_states())
def test_discrete_gradient_at_no_increment_is_the_gradient(y):
    z = MODEL.entropy_variables(y)
    assert np.allclose(MODEL.discrete_gradient(z, z), MODEL.gradient(z), rtol=1e-12, atol=1e-12)


@settings(max_examples=25)
@given(st.floats(100, 900), st.floats(100, 900))
def test_friction_is_symmetric_semidefinite_degenerate_and_gives_the_conduction(a, b):
    theta = np.array([a, b])
    M = MODEL.friction(theta)
    scale = np.abs(M).max()
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() >= -1e-13 * scale
    assert np.abs(M @ theta).max() <= 1e-13 * scale * theta.max()  # (9)
    rate = MODEL.conductivity * np.array([b / a - 1, a / b - 1])  # (22)
    assert np.allclose(M @ np.ones(2), rate, rtol=1e-12, atol=1e-13 * scale)


def test_poisson_matrix_is_skew_and_annihilates_the_entropy_gradient():
    assert np.array_equal(MODEL.L, -MODEL.L.T)
    assert np.array_equal(MODEL.L @ MODEL.DS, np.zeros(10))
