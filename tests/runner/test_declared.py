"""What a run folder says of its methods and scenarios, so that a report needs no plugins."""

import pytest

import tcbench
import tcbench.runner.rows
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


def test_rates_at_the_start_are_those_of_the_equations():
    """Conduction decays with 2 kappa/c0 = 120, a pendulum swings with sqrt(k/m) = 3; large systems have none."""
    stiff, slow = (tcbench.scenarios()[name] for name in ("short_term", "damped_oscillator"))
    assert declared.rates(stiff)[0] == pytest.approx(120, rel=0.03)
    swing = slow.replace(friction=0.0, stiffness=9.0, initial={"q": 0, "p": 0, "s": 0})
    assert declared.rates(swing) == [0.0, 3.0]
    assert declared.rates(tcbench.plugins.find_scenario("gas_tube")) is None


@pytest.mark.usefixtures("here")
def test_a_folder_keeps_what_earlier_runs_declared(tmp_path):
    for name, scenario in (("tc_monolithic", "short_term"), ("tc_strang", "gas_containers")):
        tcbench.run([name], [scenario], ["conservation"], tmp_path, dt=[0.5], jobs=1)
    store = tcbench.runner.rows.Store.read(tmp_path)
    assert set(store.declared()["integrators"]) == {"tc_monolithic", "tc_strang"}
    assert set(store.declared()["scenarios"]) == {"short_term", "gas_containers"}
    assert store.declared()["scenarios"]["short_term"]["initial_exergy"] == pytest.approx(48.52274189489995)
    (tmp_path / "declared.json").write_text("[")
    assert store.declared() == {} and "declared.json" in store.problems[-1]
