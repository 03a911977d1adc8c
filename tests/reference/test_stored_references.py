"""Certified references: two precisions, an unrelated method, and digits published elsewhere agree."""

from decimal import Decimal, localcontext

import pytest
from certified_scenarios import SCENARIOS

from tcbench.reference.certified import scenario_hash, stored_file

tool = pytest.importorskip("benchmarks.stored_references")
exact_invariants, exact_state = tool.exact_invariants, tool.exact_state

# Twenty digits from the project's independent oracle.
ORACLE = {
    (
        "short_term",
        "1",
    ): "1.5895928678481363203 4.0028041675297446839 3.736897584681968334 -0.40450629831574224972 "
    "0.76487732990986293532 5.7596886167318336099 3.882703437832831369 -1.5158252665756274906 "
    "0.5654757062370114219 0.73002895262877143456",
    (
        "short_term",
        "25",
    ): "25.384584961546331332 140.64152041407792438 49.67901328641219789 -11.545971582343552167 "
    "1.0717596977132981871 4.6201888827225725105 3.7002531600515898808 -0.14635318174391662108 "
    "0.57089050215521831616 0.7246141609658312792",
    (
        "long_term",
        "500",
    ): "3499.8276141550800965 2140.7260725237158051 -318.49010746358369007 -666.65401090172501936 "
    "6.2822644274161301299 3.773996327123026104 -0.66689978522575288348 -2.2118806614543359228 "
    "1.3179363647625751853 1.4854184149429136974",
    ("bound_equilibrium", "50"): "4.6563986716917993725 4.064608227220884439 5.7710685430312398399 "
    "4.5110857084084057601 -0.73912644097384817482 1.2970403367441404779 -0.97789826515934080741 "
    "0.78751807638213794233 0.36590757990787021781 0.17946983634868091303",
}
INVARIANTS = {  # E0, S0, J0
    "short_term": ("421.64110579977235469", "1.243727879682908186", "2.0"),
    "long_term": ("910.46366607127652993", "2.5829576497099948376", "19.6"),
    "bound_equilibrium": ("173.03573584848614507", "0.53207724634128019747", "18.0"),
}
LAST_DIGIT = Decimal("5.1e-20")  # half a unit of the twentieth digit, relative, at worst


def relative(a: str, b: str) -> Decimal:
    with localcontext(prec=60):
        return abs(Decimal(a) - Decimal(b)) / abs(Decimal(b))


@pytest.mark.parametrize(("name", "t"), ORACLE)
def test_stored_states_agree_with_the_oracle_to_all_its_digits(name, t):
    record = stored_file()["scenarios"][name]
    state = record["states"][record["times"].index(t)]
    assert max(relative(a, b) for a, b in zip(state, ORACLE[name, t].split(), strict=True)) < LAST_DIGIT


@pytest.mark.parametrize("name", INVARIANTS)
def test_invariants_agree_with_the_oracle(name):
    record = stored_file()["scenarios"][name]
    for key, expected in zip(("E0", "S0", "J0"), INVARIANTS[name], strict=True):
        assert relative(record[key], expected) < LAST_DIGIT


@pytest.mark.parametrize("name", SCENARIOS)
def test_certificates_are_below_1e_20_and_the_unrelated_method_agrees(name):
    record = stored_file()["scenarios"][name]
    assert max(map(float, record["precision_gap"])) < 1e-40
    # The cross-check carries 5e-20; sensitivity to the data, which `double_gap` shows, magnifies that too.
    for cross, double in zip(record["cross_gap"], record["double_gap"], strict=True):
        assert float(cross) < 1e-15 + 0.03 * float(double)
    assert all(len(x.replace("-", "").replace(".", "").strip("0")) >= 22 for z in record["states"] for x in z)


@pytest.mark.parametrize("name", SCENARIOS)
def test_stored_states_keep_energy_and_momentum_and_never_lose_entropy(name):
    """Evaluated in decimal arithmetic, unrelated to both methods; 30 digits leave 1e-24 of |q||p| ~ 1e4."""
    record = stored_file()["scenarios"][name]
    constants = SCENARIOS[name][0]
    start = exact_invariants(constants, exact_state(*SCENARIOS[name][:2]))
    S = start["S"]
    for z in record["states"]:
        now = exact_invariants(constants, [Decimal(x) for x in z])
        assert abs(now["E"] - start["E"]) < Decimal("1e-24") and abs(now["J"] - start["J"]) < Decimal("1e-22")
        assert now["S"] > S
        S = now["S"]


def test_a_flipped_digit_is_noticed():
    """Broken on purpose: one digit in the twenty-fifth place moves the energy out of tolerance."""
    record = stored_file()["scenarios"]["short_term"]
    z = [Decimal(x) for x in record["states"][0]]
    z[4] += Decimal("1e-23")
    E0 = exact_invariants(SCENARIOS["short_term"][0], exact_state(*SCENARIOS["short_term"][:2]))["E"]
    assert abs(exact_invariants(SCENARIOS["short_term"][0], z)["E"] - E0) > Decimal("1e-24")


def test_stored_hashes_match_the_scenarios():
    for name, (constants, initial, times) in tool.scenarios().items():
        record = stored_file()["scenarios"][name]
        assert record["hash"] == scenario_hash(constants, initial) and record["times"] == list(times)
    assert stored_file()["scenarios"].keys() == tool.TIMES.keys()


def test_data_are_exact_decimals():
    """2.2 as 22/10: the double nearest to 2.2 would change the seventeenth digit of s_b."""
    exact, rounded = (exact_state(*SCENARIOS["short_term"][:2], rounded=r) for r in (False, True))
    assert exact[2] == Decimal("2.2") and rounded[2] == Decimal(2.2)  # noqa: RUF032
    assert relative(str(exact[9]), "0.20041342547374527782") < LAST_DIGIT
    assert relative(str(rounded[9]), "0.20041342547374527782") > LAST_DIGIT


def test_recomputing_reproduces_the_stored_digits_and_a_corrupted_record_does_not():
    pytest.importorskip("heyoka")
    record = stored_file()["scenarios"]["short_term"]
    good = tool.compare("short_term", {**record, "times": ["1", "5"], "states": record["states"][:2]})
    assert good["agrees"] and max(good["stored_gap"]) < 1e-28
    bad = [list(z) for z in record["states"][:1]]
    bad[0][3] = bad[0][3][:-14] + "12345678123456"
    assert not tool.compare("short_term", {**record, "times": ["1"], "states": bad})["agrees"]
