"""Arrays over spaces as formulas see them: what is not known is refused, never left out."""

import numpy as np
import pytest
from networks import NETWORKS

from tcbench.compiler.array_kernels import array_kernel
from tcbench.compiler.array_mesh import Block, Mesh
from tcbench.compiler.array_symbols import ArraySymbol
from tcbench.compiler.arrays import variable
from tcbench.compiler.symbols import array
from tcbench.errors import MachineError, TcbenchError


@pytest.mark.parametrize(
    ("formula", "sentence"),
    [(lambda x: np.add.reduce(x, initial=1.0), r"np.add with reduce or \['initial'\]"),
     (lambda x: np.maximum.reduce(x, axis=0, initial=1.0), r"np.maximum with reduce or \['axis', 'initial'\]"),
     (lambda x: np.linalg.norm(x, 1), "this norm"), (np.linalg.norm, "this norm")],
)  # fmt: skip
def test_options_that_change_a_sum_are_refused(formula, sentence):
    x = ArraySymbol("node", array([variable("x", "node"), variable("y", "node")]))
    with pytest.raises(TcbenchError, match=sentence):
        formula(x)


def test_a_sum_with_an_infinite_term_is_infinite():
    """The compensated one had NaN there: infinity less infinity."""
    model = NETWORKS["row"].model
    z = model.state(NETWORKS["row"].z0.copy())
    z.s[1] = 1e4
    assert model.energy(np.array(z)) == np.inf


def test_more_entries_than_tables_can_tell_are_refused():
    """They tell places by whole numbers of 32 bits."""
    x = variable("x", "node")
    kernel = array_kernel({"a": [Block("node", (x,))]}, [Block("node", (x * x,))])
    kernel.kernel(Mesh({"node": 2**31 - 1}, {}))
    with pytest.raises(MachineError, match="32 bits"):
        kernel.kernel(Mesh({"node": 2**31}, {}))
