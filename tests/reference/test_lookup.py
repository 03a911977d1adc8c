"""Every scenario is measured against its own reference: by its numbers, never by its name alone."""

import time
from dataclasses import replace

import numpy as np
import pytest
from certified_scenarios import SCENARIOS
from mechanics import OfEntropies

import tcbench
from tcbench import TcbenchError, cache
from tcbench.commands.actions import reference_command
from tcbench.reference import certified as reference
from tcbench.reference import lookup as truth
from tcbench.reference import pairs, tape
from tcbench.reference.collocation import ReferenceFailed
from tcbench.reference.digits import exactly

PAPER = tcbench.scenarios()["short_term"].plugin
NAMES = [name for name, scenario in tcbench.scenarios().items() if scenario.plugin == PAPER]
ULPS = 50 * np.finfo(float).eps  # a vector field of some hundred operations, each right to half a unit; 19 without FMA


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """References computed on the fly in a test are not the user's (kernels stay where they are)."""
    folder = cache.folder
    monkeypatch.setattr(cache, "folder", lambda part: tmp_path if part == "references" else folder(part))


def test_every_scenario_of_the_paper_plugin_is_certified():
    assert set(NAMES) == set(SCENARIOS)


@pytest.mark.parametrize("name", NAMES)
def test_stored_hash_is_the_hash_of_the_scenario(name):
    """The stored file repeats the numbers: they must be those of the plugin."""
    digest = truth.content_hash(tcbench.scenarios()[name])
    assert digest == reference.stored_file()["scenarios"][name]["hash"]
    assert digest == reference.scenario_hash(*SCENARIOS[name][:2])


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_has_a_certified_state_at_its_convergence_time(name):
    scenario = tcbench.scenarios()[name]
    known = truth.reference_for(scenario, [scenario.t_converge])
    assert known.exact and known.certificate[0] < 1e-20


@pytest.mark.parametrize("name", NAMES)
def test_the_vector_field_in_many_digits_is_the_compiled_one(name):
    scenario = tcbench.scenarios()[name]
    first, second = exactly(scenario, "vector_field", [scenario.z0, scenario.z0])
    compiled = np.asarray(scenario.model.vector_field(scenario.z0))
    assert first == second and reference.gap([float(x) for x in first], compiled) < ULPS


@pytest.mark.parametrize("name", ["short_term", "stiff_spring", "fast_conduction", "bound_equilibrium"])
def test_on_the_fly_reference_agrees_with_the_certified_one(name):
    """Computed from the traced equations and not told of the stored digits: certificate below 1e-21, the distance to
    the stored state what rounding the data to double does (`floor`), within the two units that the floor is read to."""
    scenario = tcbench.scenarios()[name]
    known = truth.reference_for(scenario, [1.0])
    made = truth._Recipe(scenario, (1.0,)).compute()
    assert made.certificate[0] < 1e-21 and "double-double" in made.source
    assert reference.gap(made.states[0], known.states[0]) < 2 * known.floor[0] + 2 * made.floor[0]


def test_a_variant_never_gets_the_stored_reference():
    scenario = tcbench.scenarios()["short_term"]
    variant = scenario.replace(coupling=0.21)  # same name, other physics
    assert variant.name == scenario.name
    assert truth.stored_for(variant) is None and truth.stored_for(scenario) is not None
    known, made = truth.reference_for(scenario, [1.0]), truth.reference_for(variant, [1.0])
    assert reference.gap(made.states[0], known.states[0]) > 1e-6
    assert made.certificate[0] < 1e-15 and not made.exact


def test_names_horizon_and_step_do_not_matter():
    scenario = tcbench.scenarios()["short_term"].replace(name="renamed", t_end=3.0, dt=0.1)
    assert truth.reference_for(scenario, [1.0]).exact


def test_times_that_are_not_stored_are_computed_and_kept():
    scenario = tcbench.scenarios()["short_term"]
    first = truth.reference_for(scenario, [0.5, 1.0])
    assert first.times == (0.5, 1.0) and not first.exact
    files = list(cache.folder("references").iterdir())
    again = truth.reference_for(scenario, [0.5, 1.0])
    assert np.array_equal(first.states, again.states) and list(cache.folder("references").iterdir()) == files
    truth.reference_for(scenario, [0.5])
    assert len(list(cache.folder("references").iterdir())) == 2  # other times, another key


def test_a_subclass_of_the_pendulum_is_another_system():
    from tcbench.systems.pendulum import Pendulum

    class Softer(Pendulum):
        def element_energy(self, pi, s):
            return 0.5 * super().element_energy(pi, s)

    scenario = tcbench.scenarios()["short_term"]
    other = tcbench.Scenario(
        "short_term",
        Softer,
        scenario.constants,
        scenario.positions,
        scenario.momenta,
        scenario.temperatures,
        t_end=25,
        dt=0.3,
    )
    assert truth.content_hash(other) is None and truth.stored_for(other) is None


def test_recomputing_on_the_fly_agrees_with_itself_and_notices_a_corrupted_cache():
    scenario = tcbench.scenarios()["bound_equilibrium"].replace(conductivity=11.0, t_end=2.0)
    report = truth.recompute(scenario)
    assert report["agrees"] and [row["t"] for row in report["rows"]] == [1.0, 2.0]
    (path,) = cache.folder("references").iterdir()
    text = cache.read("references", path.name).decode()
    digit = text.index('"states": [[') + len('"states": [[') + 5
    wrong = text[:digit] + str((int(text[digit]) + 1) % 10) + text[digit + 1 :]
    cache.write("references", path.name, wrong.encode())  # with a checksum that fits
    assert not truth.recompute(scenario)["agrees"]


def test_what_makes_references_is_in_their_key(monkeypatch):
    """A mended collocation kept the old references: the files of the package are part of the key."""
    scenario = tcbench.scenarios()["short_term"]
    before = truth._Recipe(scenario, (1.0,)).key
    assert before == truth._Recipe(scenario, (1.0,)).key is not None
    monkeypatch.setattr(cache, "sources", lambda package: f"others of {package}")
    assert truth._Recipe(scenario, (1.0,)).key != before


def test_recomputing_a_stored_reference_confirms_it_and_notices_another_digit(monkeypatch):
    scenario = tcbench.scenarios()["short_term"]
    report = truth.recompute(scenario)
    assert report["agrees"] and [row["t"] for row in report["rows"]] == [1.0, 5.0, 25.0]
    assert max(row["gap"] for row in report["rows"]) < 1e-15
    assert max(row["check"] for row in report["rows"]) < 1e-13  # of collocations in doubles
    kept = truth.stored_for(scenario)
    wrong = replace(kept, states=kept.states * (1 + 1e-14))
    monkeypatch.setattr(truth, "stored_for", lambda _: wrong)
    assert not truth.recompute(scenario)["agrees"]


def test_what_the_series_cannot_do_the_collocations_do(monkeypatch):
    """Equations too stiff for series, too large, or with a function that has none."""
    scenario = tcbench.scenarios()["reaction"]
    by_series = truth._Recipe(scenario, (5.0,)).compute()
    without = (tape._Recorder, "functions", lambda self: {})
    for where, name, value in ((pairs, "MAX_STEPS", 1), (pairs, "LARGEST", 100), without):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value)
            tape.tape.cache_clear()
            made = truth._Recipe(scenario, (5.0,)).compute()
        assert "collocation" in made.source and reference.gap(made.states[0], by_series.states[0]) < 2e-15
    tape.tape.cache_clear()


def test_series_of_other_equations_than_the_compiled_ones_certify_nothing(monkeypatch):
    """A mistake in a recurrence, which both runs of a pair would share."""
    scenario = tcbench.scenarios()["heavy_top"]
    assert pairs.solve([scenario.model], [scenario.z0], [1.0])[0] is not None
    wrong = {**tape.CODE, "add": tape.CODE["sub"]}
    monkeypatch.setattr(tape, "CODE", wrong)
    tape.tape.cache_clear()
    assert pairs.solve([scenario.model], [scenario.z0], [1.0]) == [None]
    tape.tape.cache_clear()


def test_a_solution_that_cannot_be_computed_is_an_error_that_says_where(monkeypatch):
    monkeypatch.setattr(truth, "DEADLINE", 0.0)
    monkeypatch.setattr(pairs, "MAX_STEPS", 1)
    scenario = tcbench.scenarios()["short_term"].replace(coupling=0.22)
    with pytest.raises(ReferenceFailed, match=r"stopped at t = .*smaller t_converge"):
        truth.reference_for(scenario, [1.0])


def test_a_motion_that_chatters_is_told_as_such_and_soon():
    """x' = -sign(x - 1/2) stays at 1/2 from t = 1/2 on (https://github.com/OpenModelica/OpenModelica/issues/9711)."""

    class Dragged(OfEntropies):
        variables = {"x": (), "s": ()}

        def energy(self, z):
            return abs(z.x - 0.5) + 2 * z.s

        def irreversible(self, z, dE, dS):
            return {"x": -dE.x, "s": dE.x**2 / dE.s}

    scenario = tcbench.Scenario("dragged", Dragged, {}, initial={"x": 1.0, "s": 0.0}, t_end=1, dt=0.1)
    with pytest.raises(ReferenceFailed, match=r"no further than t = 0\.5 of 0\.8: the rates jump"):
        truth.reference_for(scenario, [0.8])


def test_a_reference_that_failed_is_not_tried_by_each_method_again(monkeypatch):
    scenario, tries = tcbench.scenarios()["short_term"].replace(coupling=0.22), []

    def failing(*_, **__):
        tries.append(1)
        raise ReferenceFailed("no end in sight")

    monkeypatch.setattr(truth._Recipe, "compute", failing)
    for _ in range(3):
        with pytest.raises(ReferenceFailed, match="no end in sight") as raised:
            truth.reference_for(scenario, [1.0])
    (note,) = cache.folder("references").glob("*.failed")
    assert len(tries) == 1 and str(note) in str(raised.value)
    note.unlink()
    with pytest.raises(ReferenceFailed):
        truth.reference_for(scenario, [1.0])
    long_ago = time.time() - 30 * 24 * 3600.0
    monkeypatch.setattr(truth.time, "time", lambda: long_ago)  # the clock was set back
    with pytest.raises(ReferenceFailed):
        truth.reference_for(scenario, [1.0])
    monkeypatch.setattr(truth, "REMEMBERED_S", 0.0)  # another day
    with pytest.raises(ReferenceFailed):
        truth.reference_for(scenario, [1.0])
    assert len(tries) == 4


def test_a_reference_that_cannot_be_had_again_is_one_sentence(monkeypatch):
    """`tcbench reference` ended in a traceback."""

    def failing(*_):
        raise ReferenceFailed("no end in sight")

    monkeypatch.setattr(truth, "recompute", failing)
    with pytest.raises(TcbenchError, match="short_term has no reference: no end in sight"):
        reference_command(["short_term"], [], False)
