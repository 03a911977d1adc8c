"""Which orders there are, which is best, and up to which size series are written out."""

ORDERS = (8, 10, 12, 14, 16, 18, 20)
MOST_ORDER = 16  # of elements: with more, steps that are damped are hardly longer, and err ten times as much
LEAST, EFFORT = 5.6, 0.46  # the best order is about LEAST - EFFORT ln(tolerance): measured, docs/methods-explained.md

# Beyond these series are loops: straight-line code is five times as fast, but takes more than ten seconds to compile.
MOST_ELEMENTS = 32
MOST_VARIABLES = 100  # of a system that has no elements


def is_long(system):
    """Would the series be too long, written out?"""
    if system.defines("element_energy"):
        return system.n_elements > MOST_ELEMENTS
    return system.size > MOST_VARIABLES
