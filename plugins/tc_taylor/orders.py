"""Which orders there are, which is best, and up to which size series are written out."""

ORDERS = (8, 10, 12, 14, 16, 18, 20)
MOST_ORDER = 16  # of elements: with more, steps that are damped are hardly longer, and err ten times as much
# Of rates under constraints, at any tolerance: with 14 they take twice as long to compile and, of four_masses and
# director_body at 1e-6 and 1e-9, 1.3 to 1.5 times as long to run: the code leaves the processor's cache.
LONG_ORDER = 10
LEAST, EFFORT = 5.6, 0.46  # the best order is about LEAST - EFFORT ln(tolerance): measured, docs/methods-explained.md

# Beyond these series are loops: straight-line code is five times as fast, but takes more than ten seconds to compile.
MOST_ELEMENTS = 32
MOST_VARIABLES = 100  # of a system that has no elements


def is_long(system):
    """Would the series be too long, written out?"""
    if system.defines("element_energy"):
        return system.n_elements > MOST_ELEMENTS
    return system.size > MOST_VARIABLES
