"""What tests of tc_gauss read from its records."""

import numpy as np


def matrix_of(work):
    """The matrix that iterations are solved with, dense."""
    s = work.sparse
    matrix = np.zeros((s.n, s.n))
    matrix[np.repeat(np.arange(s.n), np.diff(s.rows)), s.sees] = -s.values[: s.n_values]
    return matrix
