"""References that are read, and references that are computed on the fly, are as accurate as they say."""

import json
from decimal import Decimal, localcontext
from pathlib import Path

import numpy as np
import pytest
from certified_scenarios import SCENARIOS

from tcbench import TcbenchError, cache
from tcbench.plugins import find_scenario
from tcbench.reference import certified as R
from tcbench.reference import lookup, pairs
from tcbench.reference.collocation import ReferenceFailed, radau


def tool():
    """A script that an installed package is without."""
    return pytest.importorskip("benchmarks.stored_references")


class Doubles:
    """A right-hand side, with a Jacobian by differences."""

    def __init__(self, rhs):
        self.rhs = rhs

    def rate(self, t, z):
        return np.asarray(self.rhs(z), float)

    def rows(self, z):
        return np.array([self.rate(0.0, row) for row in z])

    def jacobian(self, t, z):
        steps = 1e-6 * np.maximum(1, np.abs(z)) * np.eye(len(z))
        return np.array([(self.rate(t, z + s) - self.rate(t, z - s)) / (2 * s.sum()) for s in steps]).T


def compute(rhs, *more, **options):
    return R.compute(Doubles(rhs), *more, **options)


def oscillator(z):
    """A stiffly damped third component beside a harmonic oscillator; exact solution below."""
    return np.array([z[1], -z[0], -200 * (z[2] - z[0])])


def oscillator_exact(t):
    a = 200.0
    steady = (a * a * np.cos(t) + a * np.sin(t)) / (a * a + 1)
    return np.array([np.cos(t), -np.sin(t), steady - a * a / (a * a + 1) * np.exp(-a * t)])


@pytest.mark.parametrize("s", [2, 6, 9, 13])
def test_the_tableau_satisfies_the_quadrature_and_stage_conditions(s):
    """B(2s - 1) and C(s), to some units of round-off."""
    tab = radau(s)
    for k in range(1, 2 * s):
        assert abs(tab.b @ tab.c ** (k - 1) - 1 / k) < 1e-14
    for k in range(1, s + 1):
        assert np.max(np.abs(tab.A @ tab.c ** (k - 1) - tab.c**k / k)) < 1e-14
    assert abs(tab.b @ tab.c ** (2 * s - 1) - 1 / (2 * s)) > 1e-3 or s > 2


def test_a_collocation_reaches_1e_14_on_a_stiff_problem():
    made = compute(oscillator, [1.0, 0.0, 0.0], [0.5, 3.0, 10.0])
    assert max(made.certificate) < 1e-13
    for t, z in zip(made.times, made.states, strict=True):
        assert R.gap(z, oscillator_exact(t)) < 4e-15


def test_a_non_smooth_problem_gets_a_poor_certificate_not_a_good_one():
    """Broken on purpose: |z| has a kink, so high order is lost; the certificate must own up to it."""
    kinked = lambda z: np.array([z[2], abs(z[0] - 0.3), -z[0]])  # noqa: E731
    made, tight = (compute(kinked, [0.0, 0.0, 1.0], [2.0], tolerance=tol) for tol in (1e-3, 1e-12))
    assert R.gap(made.states[0], tight.states[0]) < 10 * made.certificate[0]


def test_a_solution_that_blows_up_is_an_error_that_says_where():
    with pytest.raises(ReferenceFailed, match=r"no further than t = (0\.99|1)"):
        compute(lambda z: z * z, [1.0], [2.0], max_seconds=20)


@pytest.mark.parametrize("times", [[], [0.0, 1.0], [2.0, 1.0]])
def test_nonsense_times_are_refused(times):
    with pytest.raises(ValueError, match="positive and increasing"):
        compute(oscillator, [1.0, 0.0, 0.0], times)


def test_stored_reference_by_name_and_by_content():
    by_name = R.stored("short_term")
    assert by_name.times == (1.0, 5.0, 25.0) and by_name.states.shape == (3, 10)
    assert max(by_name.certificate) < 1e-20 and all(
        f >= c for f, c in zip(by_name.floor, by_name.certificate, strict=True)
    )
    assert np.array_equal(by_name.at(5), by_name.states[1])
    constants, initial, _ = SCENARIOS["relative_equilibrium"]
    merged = R.stored(R.scenario_hash(constants, initial))
    assert merged.times == (1.0, 25.0, 500.0, 1500.0)
    with pytest.raises(KeyError, match="t = 1, 5, 25"):
        by_name.at(2.0)


def test_unknown_and_stale_references_are_absent():
    assert R.stored("nothing") is None
    constants, initial, _ = SCENARIOS["short_term"]
    assert R.stored(R.scenario_hash({**constants, "coupling": 0.21}, initial)) is None
    assert R.stored(R.scenario_hash(constants, initial)) is not None


def test_hash_sees_numbers_not_types():
    constants, initial, _ = SCENARIOS["short_term"]
    same = {**constants, "masses": np.array([1, 2]), "conductivity": 300}
    assert R.scenario_hash(same, initial) == R.scenario_hash(constants, initial)
    assert R.scenario_hash(constants, {**initial, "momenta": (0.0, 2.0, 1.0, 1e-300)}) != R.scenario_hash(
        constants, initial
    )


def test_cache_reads_what_it_wrote_and_distrusts_a_damaged_file(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "folder", lambda part: tmp_path)
    calls, name = [], "0" * 32 + ".json"

    def make():
        calls.append(1)
        return compute(oscillator, [1.0, 0.0, 0.0], [0.5])

    first = R.cached("0" * 32, make)
    second = R.cached("0" * 32, make)
    assert len(calls) == 1 and np.array_equal(first.states, second.states) and second.certificate == first.certificate
    path = tmp_path / name
    whole = path.read_bytes()
    digit = whole.index(b'"states": [[') + 20
    changed = str((int(whole[digit : digit + 1]) + 1) % 10).encode()
    for damaged in (whole[:40], whole[:digit] + changed + whole[digit + 1 :], b""):
        path.write_bytes(damaged)
        assert np.array_equal(R.cached("0" * 32, make).states, first.states) and path.read_bytes() == whole
    cache.write("references", name, json.dumps({**json.loads(cache.read("references", name)), "format": -1}).encode())
    R.cached("0" * 32, make)
    assert len(calls) == 5 and path.read_bytes() == whole and [p.name for p in tmp_path.iterdir()] == [name]


def test_a_digit_of_the_stored_references_that_was_changed_is_noticed():
    text = Path(R.__file__).with_name("data").joinpath("references.json").read_text()
    digit = text.index("0.", text.index('"states"')) + 20
    assert text[digit].isdigit() and R.verified(text) == R.stored_file()
    changed = text[:digit] + str((int(text[digit]) + 1) % 10) + text[digit + 1 :]
    for wrong in (changed, text.replace('"sha256"', '"sha"')):
        with pytest.raises(TcbenchError, match="stored references were changed, or damaged"):
            R.verified(wrong)


@pytest.mark.parametrize(("seed", "t"), [(16, 25.0), (3, 1.0)])  # of the first, too far at first
def test_a_certificate_is_never_below_the_true_error(seed, t, monkeypatch):
    """Of both kinds, against heyoka's series of 160 bits from the same doubles. docs/truth.md: how many were tried."""
    pytest.importorskip("heyoka")
    scenario, ends, integrate = find_scenario(f"random[seed={seed}]"), [], R.integrate
    initial = {name: getattr(scenario, name) for name in ("positions", "momenta", "temperatures")}
    (digits,) = tool().taylor_states(scenario.constants, initial, [str(t)], 160, rounded=True)
    exact = np.array([float(x) for x in digits])
    (pair,) = pairs.solve([scenario.model], [scenario.z0], [t])
    with localcontext(prec=50):
        found = [Decimal(float(h)) + Decimal(float(l)) for h, l in zip(pair.states[0], pair.low[0], strict=True)]
        error = max(abs(a - b) / max(1, abs(b)) for a, b in zip(found, digits, strict=True))
    assert error < pair.certificate[0] < 1e-12
    monkeypatch.setattr(R, "integrate", lambda *a, **k: ends.append(integrate(*a, **k)[0]) or ends[-1][None])
    for made in (lookup._Recipe(scenario, (t,)).compute(), lookup._Recipe(scenario, (t,)).collocations()):
        assert R.gap(made.states[0], exact) < made.floor[0]
    assert R.gap(ends[0], exact) < made.certificate[0] < 1e-6  # what chaos leaves of doubles
