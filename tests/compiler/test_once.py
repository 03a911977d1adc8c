"""What is made once and kept."""

from tcbench.compiler.once import Spares


class Thing:
    """Of which there may be weak references."""


def test_a_method_is_kept_for_the_next_run_of_its_system():
    spares = Spares(lambda system, order: [order], lambda tolerance: (2 * (tolerance // 2),))
    one, other = Thing(), Thing()
    made, free = spares.take(one, 8)
    free.append(made)
    assert spares.take(other, 8)[0] is not made
    assert spares.take(one, 10) == ([10], [])
    assert spares.take(one, 8)[0] is made
    assert spares.take(one, 8)[0] is not made  # two runs at a time
    free.append(made)
    assert spares.take(one, 9)[0] is made  # of a tolerance that asks for the same


def test_what_is_kept_for_a_system_goes_with_it():
    spares = Spares(lambda system, order: [order], lambda tolerance: (2 * (tolerance // 2),))
    system = Thing()
    for order in (8, 10):
        made, free = spares.take(system, order)
        free.append(made)
    del system
    assert not spares.free
