"""Which methods are tried on which systems: each method on one, each system with some. A pair costs its compiling."""

import tcbench
from tcbench.plugins import find_integrator

SCENARIOS = tcbench.scenarios()
PENDULUM = [name for name, s in SCENARIOS.items() if s.model.name == "pendulum"]  # one set of kernels for all of them
OTHERS = [name for name in SCENARIOS if name not in PENDULUM]
CORE = ("tc_monolithic", "tc_gauss", "tc_auto")  # of each kind one, on every system


def suits(method, name):
    return not find_integrator(method).suits(SCENARIOS[name].model)


def spread(methods, names, core=CORE, suits=suits):
    """(method, name) pairs: `core` on every name, each other method on the next one that suits it."""
    pairs, turn = [], 0
    for method in methods:
        fit = [name for name in names[turn:] + names[:turn] if suits(method, name)]
        pairs += [(method, name) for name in (fit if method in core else fit[:1])]
        turn = (turn + (method not in core)) % len(names)
    return pairs
