"""Formulas traced on one element for all: equal to the whole trace, and refused where they would not be."""

import dataclasses

import numpy as np
import pytest
from tcbench_plugins.net.net import net

import tcbench
from tcbench.compiler.symbols import MixedSpaces
from tcbench.solver import flow_kernels, implicit_step, patch
from tcbench.solver.space_flow import space_flow

METHODS = [
    "tc_monolithic", "tc_staggered", "midpoint_entropy", "midpoint_temperature", "midpoint_temperature[reading=rate]",
    "tc_gonzalez", "tc_itoh_abe", "tc_mean_value", "gauss2", "projected[method=midpoint_entropy]",
]  # fmt: skip
SCENARIO = net(4, 4)


@pytest.fixture
def whole(monkeypatch):
    """Trace everything as a whole."""

    def run(*arguments, **options):
        with monkeypatch.context() as m:
            m.setattr(flow_kernels, "FEW", 10**6)
            implicit_step._compiled_flows.cache_clear()
            found = tcbench.simulate(*arguments, **options)
        implicit_step._compiled_flows.cache_clear()
        return found

    return run


@pytest.mark.parametrize("method", METHODS)
def test_every_flow_is_that_of_the_whole_trace(method, whole):
    scenario = net(3, 2)  # the work of the whole trace grows with the cube of the unknowns
    for flow in tcbench.integrators()[method.partition("[")[0]].flows if "[" not in method else ():
        assert space_flow(flow, scenario.model.symbolic).terms
    run, expected = tcbench.simulate(method, scenario, dt=0.1, t_end=0.5), whole(method, scenario, dt=0.1, t_end=0.5)
    assert run.ok and "loops over the elements" in run.solver.way
    assert "loops over the elements" not in expected.solver.way
    assert np.abs(run.z - expected.z).max() < 1e-11


def mixing(z0, z1, h, system):
    dz = system.state(z1 - z0 - h * system.vector_field(z0))
    return dz + 1e-3 * (z0.q[0] - z0.q[1])


def by_length(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0) * (len(z0.q) / 100.0)


def by_place(z0, z1, h, system):
    return (z1 - z0) - h * system.vector_field(z0) * np.linspace(1.0, 2.0, len(z0))


def with_mean(z0, z1, h, system):
    """A sum over all is known as one, and so is the number of elements."""
    mean = sum(system.temperatures(z0)) / system.n_elements
    return z1 - z0 - h * system.vector_field(z0) * (mean / 300.0)


def with_numpy_mean(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0) * (np.mean(system.temperatures(z0)) / 300.0)


@pytest.mark.parametrize("formula", [mixing, by_length, by_place, with_numpy_mean])
def test_what_does_not_treat_all_alike_is_traced_as_a_whole(formula, whole):
    method = tcbench.Integrator(name="odd", order=1, flows=formula)
    with pytest.raises(MixedSpaces):
        space_flow(method.flows[0], SCENARIO.model.symbolic)
    run, expected = (simulate(method, SCENARIO, dt=0.01, t_end=0.02) for simulate in (tcbench.simulate, whole))
    assert run.ok and np.array_equal(run.z, expected.z) and "as a whole" in run.solver.way


def test_means_by_sums_are_taken_over_all(whole):
    method = tcbench.Integrator(name="mean", order=1, flows=with_mean)
    run, expected = (simulate(method, SCENARIO, dt=0.01, t_end=0.05) for simulate in (tcbench.simulate, whole))
    assert "loops over the elements" in run.solver.way and np.abs(run.z - expected.z).max() < 1e-12


@pytest.mark.parametrize("part", ["terms", "opening", "iterate", "finish"])
def test_wrong_kernels_are_found_on_a_small_network(part):
    """The guard itself: kernels that are wrong in one place."""
    flow = tcbench.integrators()["tc_monolithic"].flows[0]
    made = space_flow(flow, SCENARIO.model.symbolic)
    if part == "terms":
        terms = list(made.terms)
        terms[0] = (terms[0][0], (terms[0][1] + 1) % len(made.unknowns), terms[0][2])
        wrong = dataclasses.replace(made, terms=tuple(terms))
    else:
        kernel = getattr(made, part)
        place = kernel.text.rindex(" * ")
        changed = dataclasses.replace(kernel, text=kernel.text[:place] + " + " + kernel.text[place + 3 :])
        wrong = dataclasses.replace(made, **{part: changed})
    patch.compare(made, flow, SCENARIO.model)
    with pytest.raises((MixedSpaces, ValueError, IndexError)):
        patch.compare(wrong, flow, SCENARIO.model)


def test_a_patch_is_a_small_network_of_the_same_kind():
    for scenario in (SCENARIO, net(9, 5)):
        small = scenario.model.patch(12)
        assert small.n_elements == 12 and len(small.anchors) >= 2 and small.links.max() < 12
        assert small.conductivity == scenario.model.conductivity
        q = np.random.default_rng(0).normal(size=small.n_positions)
        assert np.asarray(small.shape(q)).shape == (12,)
