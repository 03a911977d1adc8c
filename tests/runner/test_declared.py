"""What a run folder says of its methods and scenarios, so that a report needs no plugins."""

import numpy as np
import pytest

import tcbench
import tcbench.runner.rows
from tcbench import ElementSystem
from tcbench.runner import declared


def test_every_method_is_told_with_its_family_claims_and_formula():
    told = declared.declared([*tcbench.integrators().values()], [], {})["integrators"]
    assert told["tc_monolithic"]["family"] == told["midpoint_entropy"]["family"] == "Romero (2009)"
    assert {told[name]["family"] for name in ("tc_gauss", "tc_mean_value", "tc_strang_exact")} == {declared.FAMILIES[1]}
    assert told["gauss2"]["family"] == told["verlet_heat"]["family"] == "other structure"
    assert told["scipy_odeint"]["family"] == "peers"
    assert "discrete_gradient" in told["tc_monolithic"]["formula"] and "(A1)" in told["tc_monolithic"]["description"]
    assert told["tc_strang"]["description"].startswith("TC Strang")  # whose formulas stand in another plugin's file
    assert told["tc_staggered"]["formula"].count("def ") == 2
    assert told["tc_strang"]["claims"] == ["angular_momentum", "energy", "entropy"]


def test_springs_in_the_plane_are_found_and_other_elements_are_not():
    assert declared.links(tcbench.scenarios()["short_term"].model) == [[0, 1], [1, 2]]
    assert declared.links(tcbench.scenarios()["gas_containers"].model) == []


class Triangle(ElementSystem):
    """Two masses, three springs: each mass to the origin and one to the other."""

    name = "triangle"
    n_positions, n_elements = 4, 3
    constants = {"reference_temperature": ()}

    def inertia(self):
        return np.ones(4)

    def shape(self, q):
        a, b = q[:2], q[2:]
        return np.array([(b - a) @ (b - a), a @ a, b @ b])

    def element_energy(self, pi, s):
        return pi + np.exp(s)

    def conduction(self, theta):
        return 0 * theta

    def entropies(self, q, theta):
        return np.log(theta)


def test_the_springs_of_a_users_own_system_are_found_in_their_order():
    start = {"positions": (1, 0, 0, 1), "momenta": (0, 0, 0, 0), "temperatures": (1, 1, 1)}
    scenario = tcbench.Scenario("mine", Triangle, {"reference_temperature": 1}, **start, t_end=1, dt=0.1)
    assert declared.links(scenario.model) == [[1, 2], [0, 1], [0, 2]]


def test_a_folder_keeps_what_earlier_runs_declared(tmp_path):
    for name, scenario in (("tc_monolithic", "short_term"), ("tc_strang", "gas_containers")):
        tcbench.run([name], [scenario], ["conservation"], tmp_path, dt=[0.5], jobs=1)
    store = tcbench.runner.rows.Store.read(tmp_path)
    assert set(store.declared()["integrators"]) == {"tc_monolithic", "tc_strang"}
    assert set(store.declared()["scenarios"]) == {"short_term", "gas_containers"}
    assert store.declared()["scenarios"]["short_term"]["initial_exergy"] == pytest.approx(48.52274189489995)
    (tmp_path / "declared.json").write_text("[")
    assert store.declared() == {} and "declared.json" in store.problems[-1]
