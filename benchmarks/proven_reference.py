"""Proves a stored reference: balls of Arb around the exact state, and whether they hold the stored one.

python benchmarks/proven_reference.py bound_equilibrium 64 24      # ten seconds
python benchmarks/proven_reference.py short_term 1024 60           # minutes: conduction is stiff there
"""

import sys

import tcbench
from tcbench.reference.certified import stored
from tcbench.reference.enclosure import proven_state


def main() -> None:
    from flint import arb, ctx

    name, steps, order = sys.argv[1], *map(int, sys.argv[2:4])
    state = proven_state(tcbench.scenarios()[name], 1.0, steps, order)
    reference = stored(name)
    ctx.prec = 400
    exact = [arb(text) for text in reference.exact[reference.index(1.0)]]
    gaps = [float((abs(x - y) / (1 + abs(y))).upper()) for x, y in zip(state, exact, strict=True)]
    print(f"{name} at t = 1: the exact state is within {max(float(x.rad()) for x in state):.2g} of the balls' centres,")
    print(f"and within {max(gaps):.2g} (over 1 + |z|) of the stored one, whatever was rounded on the way.")


if __name__ == "__main__":  # asv imports every file here
    main()
