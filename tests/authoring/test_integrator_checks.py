"""Single lines of `tcbench check` for integrators: what they judge, and what they say of it."""

import numpy as np
from planted import explicit_midpoint, implicit_midpoint, made

import tcbench
from tcbench import simulate
from tcbench.authoring import check
from tcbench.authoring import integrator_checks as contract
from tcbench.authoring.gaps import stands_still


def test_an_exception_inside_a_step_is_shown_where_it_stops_a_line():
    def step(z, h, system):
        if h < 1e-3:
            raise RuntimeError("my root finder gave up")
        return explicit_midpoint(z, h, system)

    found = contract.consistent(made(step=step))
    assert found.verdict == check.FAIL and "my root finder gave up" in found.found and "sign" not in found.remedy


def test_claims_are_judged_on_completed_steps_as_in_the_report():
    def choosy(z, h, system, broken=False):
        if (
            not hasattr(system, "n_positions") or not hasattr(system, "stiffness") or system.stiffness[1] > 100
        ):  # refuses some scenarios
            raise RuntimeError("not for me")
        z1, q, p = np.array(z), slice(0, system.n_positions), slice(system.n_positions, 2 * system.n_positions)
        z1[p] += h * np.asarray(system.vector_field(z))[p]  # central forces keep the momentum
        z1[q] += h * np.asarray(system.vector_field(z1))[q] + broken * 1e-3 * h
        return z1

    kept = contract.claims(made(step=choosy, claims={"angular_momentum"}))
    assert kept.verdict == check.OK and "not for me" in kept.found and "angular_momentum" in kept.found
    broken = made(step=lambda z, h, s: choosy(z, h, s, True), claims={"angular_momentum"})
    assert contract.claims(broken).verdict == check.FAIL
    never = contract.claims(made(step=lambda z, h, system: 1 / 0, claims={"energy"}))
    assert never.verdict == check.FAIL and "ZeroDivisionError" in never.found


def test_a_method_that_stands_still_where_it_finds_no_step_is_told_though_it_keeps_every_law():
    def gives_up(z, h, system, above=0.05):
        return np.array(z) if h > above else explicit_midpoint(z, h, system)

    found = contract.claims(made(step=gives_up, claims={"angular_momentum", "energy"}))
    assert found.verdict == check.FAIL and "very state" in found.found and "raise" in found.remedy
    at_rest = made(step=lambda z, h, system: np.array(z), claims={"energy"})
    assert "very state" in contract.claims(at_rest).found
    lost = simulate(at_rest, tcbench.scenarios()["short_term"], dt=0.1, t_end=1.0)
    lying = simulate(at_rest, tcbench.scenarios()["short_term"], dt=1e-12, t_end=1e-11)
    assert stands_still(lost) and not stands_still(lying)


def test_a_claim_that_no_system_has_is_not_passed_as_measured():
    found = contract.claims(made(flows=implicit_midpoint, claims={"enregy"}))
    assert found.verdict == check.NONE and "metadata" in found.found


def test_a_memory_that_only_a_restart_shows_is_found():
    def step(z, h, system, memory=[None, 0]):  # noqa: B006  (the fault)
        memory[:] = [np.array(z), memory[1] + 1 if memory[0] is not None and np.allclose(z, memory[0], atol=1) else 0]
        return explicit_midpoint(z, h * (1 + 1e-4 * (memory[1] > 7)), system)

    found = contract.restart(made(step=step))
    assert found.verdict == check.FAIL and "gap" in found.found


def test_a_law_that_is_lost_is_told_with_the_place_of_the_formula():
    """A discrete gradient that is none: consistent and of its order, only its claim is broken."""

    def halves(z0, z1, h, system):
        D = (system.gradient(z0) + system.gradient(z1)) / 2
        return z1 - z0 - h * system.reversible((z0 + z1) / 2, D, system.discrete_gradients(z0, z1)[1])

    line = halves.__code__.co_firstlineno
    found = contract.claims(tcbench.Integrator(name="h", order=2, source="x", flows=halves, claims={"energy"}))
    assert found.verdict == check.FAIL and f"({__file__.rpartition('/')[2]}, line {line})." in found.remedy
    assert "D . (z1 - z0) = E(z1) - E(z0)" in found.remedy
