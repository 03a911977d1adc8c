"""`tcbench check` finds every planted fault, on its own line and with a remedy, and passes what is right."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from planted import explicit_midpoint, implicit_midpoint, made
from tiers import tiers

import tcbench
from tcbench import plugins
from tcbench.authoring import check
from tcbench.authoring import integrator_checks as contract
from tcbench.cli import main

TESTS = dict(contract.TESTS)


def verdicts(method):
    return {name: check._guarded(name, test, method) for name, test in TESTS.items()}


# ---- what is right passes


ELEMENTS = {s.name for s in tcbench.scenarios().values() if isinstance(s.model, tcbench.ElementSystem)}
PRESENT = [i for i in tcbench.integrators().values() if not i.lacks]
VARIANTS = [v.name for i in PRESENT for v in i.variants() if v.name != i.name and not v.lacks]


@pytest.mark.parametrize(
    "name", tiers([i.name for i in PRESENT], ("scipy_odeint",))
)  # laws and orders: tests/laws, tests/plugins
def test_every_built_in_passes_every_line(name):
    method = plugins.find_integrator(name)
    lines = [contract.metadata(method), *verdicts(method).values()]
    assert {line.check: line.found for line in lines if line.verdict == check.FAIL} == {}


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_passes_every_line(name):
    test_every_built_in_passes_every_line(name)


def test_an_explicit_step_with_a_right_jacobian_passes():
    def step(z, h, system):
        return explicit_midpoint(z, h, system)

    step.jacobian = lambda z, system: system.jacobian(z)
    found = verdicts(made(step=step))
    assert {line.verdict for line in found.values()} == {"ok", "-"} and found["Jacobian"].verdict == "ok"


def solve_ivp(system, z0, t_eval, rtol, atol):
    from scipy.integrate import solve_ivp

    return solve_ivp(
        lambda t, z: np.asarray(system.vector_field(z)), t_eval[[0, -1]], z0, "LSODA", t_eval, rtol=rtol, atol=atol
    ).y.T


def test_an_adaptive_solver_passes():
    outputs = lambda *given: (iter(solve_ivp(*given)), {})  # noqa: E731
    found = verdicts(made(adaptive=solve_ivp, outputs=outputs, order=None))
    assert found["outputs"].verdict == "ok"
    assert {line.verdict for line in found.values()} == {"ok", "-"} and found["order"].verdict == "ok"


@pytest.mark.parametrize("name", tiers(tcbench.scenarios(), ("reaction",)))
def test_every_built_in_scenario_passes(name):
    lines = {line.check: line for line in check.scenario_lines(tcbench.scenarios()[name])}
    assert len(lines) > 6 and not {line.check: line.found for line in lines.values() if line.verdict == check.FAIL}
    assert ("bracket" in lines) == (name not in ELEMENTS)


# ---- planted faults


def energetic(z0, z1, h, system):
    """Nearly the energy-conserving method: 1e-7 of the midpoint's gradient is mixed in."""
    DE = system.discrete_gradient(z0, z1)
    DE = DE + 1e-7 * (system.gradient((z0 + z1) / 2) - DE)
    return z1 - z0 - h * (system.L @ DE + system.dissipation(system.state(DE).s))


def hidden(z, h, system, memory=[0]):  # noqa: B006  (the fault)
    memory[0] += 1
    return explicit_midpoint(z, h * (1 + 1e-9 * memory[0]), system)


def multistep(z, h, system, memory={}):  # noqa: B006  (the fault)
    """Adams-Bashforth with the last slope in a global: a step depends on where the method has been."""
    f = np.asarray(system.vector_field(z))
    old = memory.get(f.shape, f)
    memory[f.shape] = f
    return np.asarray(z) + h * (1.5 * f - 0.5 * old)


def in_place(z, h, system):
    z += h * np.asarray(system.vector_field(z + h / 2 * system.vector_field(z)))
    return z


def in_place_formula(z0, z1, h, system):
    z0 -= h * system.vector_field((z0 + z1) / 2)
    return z1 - z0


def random(z, h, system):
    return explicit_midpoint(z, h, system) * (1 + 1e-14 * np.random.default_rng().random())


def backwards(z0, z1, h, system):
    """A wrong sign of the dissipation: second order to another equation."""
    DE = system.discrete_gradient(z0, z1)
    return z1 - z0 - h * (system.L @ DE - system.dissipation(DE.s))


def wrong_jacobian(z, h, system):
    return explicit_midpoint(z, h, system)


wrong_jacobian.jacobian = lambda z, system: system.jacobian(z) * np.where(np.arange(len(z)) == 1, -1, 1)


def wrong_residual_jacobian(z, h, system):
    return explicit_midpoint(z, h, system)


wrong_residual_jacobian.residual = implicit_midpoint
wrong_residual_jacobian.jacobian = lambda z0, z1, h, s: np.eye(len(z0)) + h / 2 * s.jacobian((z0 + z1) / 2)


def goes_on(z, h, system, held):
    held[0] += 1
    return explicit_midpoint(z, h, system) + 1e-12 * (held[0] > 2)


FAULTS = {
    "order claimed too high": (made(flows=implicit_midpoint, order=4), "order", "declared 4, measured 2.00"),
    "order claimed too low": (made(flows=implicit_midpoint, order=1), "order", "higher than declared"),
    "energy claimed but drifting": (made(flows=energetic, claims={"energy"}), "claims", "energy is violated"),
    "energy claimed by a midpoint rule": (made(flows=implicit_midpoint, claims={"energy"}), "claims", "energy"),
    "momentum claimed by a step": (made(step=explicit_midpoint, claims={"angular_momentum"}), "claims", "angular"),
    "wrong sign in a Jacobian": (made(step=wrong_jacobian), "Jacobian", "gap to differences"),
    "wrong sign in a residual's Jacobian": (made(step=wrong_residual_jacobian), "Jacobian", "gap to differences"),
    "hidden counter": (made(step=hidden), "deterministic", "differ"),
    "hidden last slope": (made(step=multistep), "deterministic", "differ"),
    "a step that goes on with its workspace": (
        made(step=goes_on, workspace=lambda system: [0]), "deterministic", "with one workspace",
    ),
    "in-place change of z0": (made(step=in_place), "input unchanged", "z0 is changed"),
    "in-place change in a formula": (made(flows=in_place_formula), "input unchanged", "in_place_formula changes"),
    "random numbers": (made(step=random), "deterministic", "differ"),
    "wrong sign in the formula": (made(flows=backwards), "consistent", "dz/dt"),
    "a march of one step too few": (
        made(step=explicit_midpoint, march=lambda z, h, count, s: [explicit_midpoint(z, h, s)] * (count - 1)),
        "march", "shape (4, 10)",
    ),
    "a march with another step": (
        made(step=explicit_midpoint, march=lambda z, h, count, s: [explicit_midpoint(z, h, s)] * count),
        "march", "from what step gives",
    ),
    "an output too few": (
        made(adaptive=solve_ivp, outputs=lambda s, z, t, r, a: (iter(solve_ivp(s, z, t, r, a)[:-1]), {}), order=None),
        "outputs", "shape (4, 10)",
    ),
    "outputs of another tolerance": (
        made(adaptive=solve_ivp, outputs=lambda s, z, t, r, a: (iter(solve_ivp(s, z, t, 0.1, 0.1)), {}), order=None),
        "outputs", "from what adaptive gives",
    ),
    "exception": (made(step=lambda z, h, system: 1 / 0), "restart", "ZeroDivisionError"),
    "tolerances ignored": (
        made(adaptive=lambda s, z, t, r, a: solve_ivp(s, z, t, 1e-3, 1e-3), order=None), "order", "errors",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found_on_its_line_with_a_remedy(fault):
    method, name, words = FAULTS[fault]
    found = check._guarded(name, TESTS[name], method)
    assert found.verdict == check.FAIL and words in found.found and found.remedy


# ---- the command


PLUGIN = """
import time
from tcbench import Integrator, hookimpl

def step(z, h, system):
    {body}
    return z + h * system.vector_field(z + h / 2 * system.vector_field(z))

@hookimpl
def tcbench_integrators():
    return [Integrator(name="{name}", order=2, source="a test", step=step)]
"""


def write(folder, body="pass", name="mine"):
    path = folder / "mine.py"
    path.write_text(PLUGIN.format(body=body, name=name))
    return str(path)


def command(*args):
    return CliRunner().invoke(main, ["check", *args])


def test_the_command_says_what_it_found_in_words_and_in_json(tmp_path):
    chosen = ["deterministic", "restart", "step too large", "time per step"]
    done = command(write(tmp_path), "--json", "--only", ",".join(chosen))
    data = json.loads(done.stdout)
    assert done.exit_code == 0 and data["ok"]
    (report,) = data["reports"]
    assert report["name"] == "mine"
    assert {line["check"] for line in report["lines"]} == {"loads", "unique name", "runs", *chosen}


def test_a_hang_and_a_crash_end_the_check_with_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "DEADLINE", 1.0)
    done = command(write(tmp_path, "time.sleep(100)"))
    assert done.exit_code == 1 and "did not end within 1 s" in done.stdout and "not checked" in done.stdout
    plugins.forget()
    monkeypatch.setattr(check, "DEADLINE", 60.0)
    done = command(write(tmp_path, "import os; os._exit(3)"))
    assert done.exit_code == 1 and "exit code 3" in done.stdout


def test_files_that_do_not_load_or_bring_nothing_fail_with_a_remedy(tmp_path):
    taken = command(write(tmp_path, name="tc_strang"))
    assert taken.exit_code == 1 and "unique name" in taken.stdout and "Rename" in taken.stdout
    for text, words in (("def broken(:\n", "invalid syntax, line 1"), ("x = 1\n", "no hook is implemented")):
        plugins.forget()
        path = tmp_path / f"_bad{len(words)}.py"  # named by itself, so no matter how it begins
        path.write_text(text)
        done = command(str(path))
        assert done.exit_code == 1 and words in done.stdout and "->" in done.stdout


def test_a_formula_for_elements_alone_is_told_on_one_line_what_every_system_has():
    """It traced on the first scenario; each of six lines then failed on the first system without elements."""

    def of_springs(z0, z1, h, system):
        return z1 - z0 - h * (system.L @ system.gradient((z0 + z1) / 2))

    *_, found, rest = check.integrator_lines(made(flows=of_springs))
    assert found.check == "runs" and rest == check.DOES_NOT_RUN
    assert "has no 'L': it is of springs" in found.found and "elements=True" in found.found


def test_unknown_targets_are_refused_with_a_sentence(tmp_path):
    assert command("tc_stran").exit_code == 2
    assert "tcbench new integrator" in command(str(tmp_path / "none.py")).output
    assert "is a folder: name a plugin file in it" in command(str(tmp_path)).output


def test_a_formula_with_which_a_run_fails_is_asked_whether_it_is_consistent(monkeypatch):
    def wrong_sign(z0, z1, h, system):
        return z1 - z0 + h * system.vector_field((z0 + z1) / 2)

    failed = check.Line("runs", check.FAIL, "no_root: step 2", check.LOOK_BELOW)
    monkeypatch.setattr(check, "_runs_alone", lambda *given: failed)
    *_, found, rest = check.integrator_lines(made(flows=wrong_sign))
    assert found.check == "consistent" and "Look for a wrong sign" in found.remedy and rest == check.DOES_NOT_RUN


def test_lines_come_as_they_are_known_and_only_some_if_asked(tmp_path, monkeypatch):
    lines = check.integrator_lines(made(step=explicit_midpoint), only=["deterministic"])
    assert [next(lines).check, next(lines).check] == ["loads", "unique name"]  # before anything was run
    done = command(write(tmp_path), "--only", "restart,metadata", "--json")
    (report,) = json.loads(done.stdout)["reports"]
    assert [line["check"] for line in report["lines"]] == ["loads", "unique name", "metadata", "runs", "restart"]
    refused = command("tc_strang", "--only", "restrt")
    assert refused.exit_code == 2 and "Did you mean 'restart'?" in refused.output
