"""Extended numbers where a platform has none of its own: the same references and verdicts from quadruple precision."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent.parent
SAME = (  # what stands on extended precision, told again
    "reference/test_lookup.py::test_on_the_fly_reference_agrees_with_the_certified_one[short_term]",
    "studies/test_claims.py::test_verdicts_are_those_of_the_ledger",
)
DESCRIBE = "from tcbench.reference import precision; print(precision.EPS < precision.ENOUGH, precision.DESCRIPTION)"


def python(*words, extended, **options):
    environment = os.environ | {"TCBENCH_EXTENDED": extended}
    return subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True, **options)


@pytest.mark.thorough
def test_quadruple_precision_gives_the_same_references_equilibria_and_verdicts(tmp_path):
    pytest.importorskip("numpy_quaddtype")
    told = python("-c", DESCRIBE, extended="quad").stdout
    assert told.startswith("True quadruple precision")
    chosen = [str(TESTS / name) for name in SAME]
    done = python(
        "-m", "pytest", "-p", "no:xdist", "-p", "no:cacheprovider", *chosen, extended="quad", cwd=TESTS.parent
    )
    assert done.returncode == 0, done.stdout[-3000:]


def test_without_any_it_says_so_and_what_to_install():
    told = python("-c", DESCRIBE, extended="double").stdout
    assert told.startswith("False double precision") and "numpy-quaddtype" in told


def test_an_unknown_precision_is_refused_with_the_known_ones():
    told = python("-c", DESCRIBE, extended="octuple").stderr
    assert "'octuple'" in told and "longdouble, quad, double" in told
