"""The records of consistent collocation (`step`): what stands where in memory."""

from __future__ import annotations

from tcbench.compiler.kernels import WIDTH  # noqa: F401  (of the shapes)
from tcbench.compiler.language import Cube, Floats, Ints, Kernel, Matrix
from tcbench.compiler.records import Record, sized

from .sparse import Sparse

# points of the quadratures, whole numbers of vectors: the coarsest that keeps the energy is taken
POINTS = (8, 16, 32, 64)
LEVELS, MOST_POINTS = len(POINTS), POINTS[-1]


class Counts(Record, mutable=True):
    """What steps cost."""

    steps: int
    rejected: int
    iterations: int
    newtons: int
    halved: int
    raised: int


class Numbers(Record):
    """The numbers of k-stage Gauss collocation with projection; see `step`."""

    k: int
    nodes: Floats = sized("k")
    barycentric: Floats = sized("k")  # weights of the nodes in Lagrange's second form
    at_start: Floats = sized("k")  # Lagrange polynomials at 0
    at_end: Floats = sized("k")  # and at 1
    A: Matrix = sized("k", "k")
    b: Floats = sized("k")
    pairs: int  # of eigenvalues of A; one that is real counts as a pair
    eigen_re: Floats = sized("pairs")  # one of each
    eigen_im: Floats = sized("pairs")
    largest: float  # of their sizes
    into_re: Matrix = sized("pairs", "k")  # a vector's parts along their eigenvectors
    into_im: Matrix = sized("pairs", "k")
    back_re: Matrix = sized("k", "pairs")  # the real vector of such parts
    back_im: Matrix = sized("k", "pairs")
    Ahats: Cube = sized("LEVELS", "MOST_POINTS", "k")  # integrals of Lagrange polynomials from 0 to quadrature points
    Ws: Cube = sized("LEVELS", "k", "MOST_POINTS")


class Work(Record):
    """The arrays of one step; k stages, n positions, m other variables, of which the last n_block are the block.

    Row i of `found` holds variable i at WIDTH nodes, of which k are used: U, N, V and rates are parts of it.
    """

    n: int
    m: int
    k: int
    size: int  # of a state
    n_block: int
    n_constants: int
    n_ends: int
    n_matrix: int  # rows of the largest matrix that is solved with, or 0
    n_factors: int
    n_lanes: int  # variables of the block where it is solved for on vectors, or 0
    n_factored: int  # numbers that its matrix is taken apart into
    n_nodes: int  # what stands in a row of these
    n_carried: int
    n_slopes: int
    n_laws: int
    n_mended: int
    n_moved: int  # momenta of elements, which stand behind as many positions
    to_start: Kernel  # see `any_system.any_formulas`
    to_motion: Kernel
    to_slopes: Kernel
    to_forces: Kernel
    to_positions: Kernel
    to_noise: Kernel
    to_move: Kernel
    to_mend: Kernel  # see solver.mending
    to_hold: Kernel
    to_laws: Kernel
    to_matrix: Kernel  # of the block, where the first has not its entries
    to_whole: Kernel  # of all variables; 0: there are no others
    to_iterate: Kernel  # those on vectors; 0: none
    to_iterate_finer: Kernel
    to_factor: Kernel  # of the block on vectors: see any_vectors.py
    to_defect: Kernel
    to_extrapolate: Kernel
    to_close: Kernel
    numbers: Numbers
    sparse: Sparse  # the matrix of the block: see stiffness.py
    whole: Sparse
    large: bool  # by formulas on arrays
    by_momenta: bool  # ends of steps are mended by `any_system.by_momenta`
    counts: Counts
    ends: Ints = sized("m")  # 1 of the last number of each array, by which sizes are measured, however it is turned
    order: Ints = sized("size")  # of a state's variables: positions, others, last the block
    c: Floats = sized("n_constants")  # the time step, the system's constants, and what depends on them only
    found: Floats = sized("WIDTH * (2 * m + n) + 1")
    U: Matrix = sized("m", "WIDTH", of="found")  # the iterate
    N: Matrix = sized("m", "WIDTH", of="found", at="WIDTH * m")  # the rates that it gives
    V: Matrix = sized("n", "WIDTH", of="found", at="WIDTH * 2 * m")  # those of positions
    rates: Floats = sized("WIDTH * (m + n)", of="found", at="WIDTH * m")  # N, then V
    kept: Floats = sized("WIDTH * (m + n)")  # those of the last step that was taken
    # h, nothing, 1 where the block is solved for, 1 if its own factors are made beside those on vectors (-1: its matrix
    # is set), 1 where the whole matrix is
    stiff: Floats = sized("5")
    # What `any_vectors.iteration` reads: the matrix of corrections, taken apart, the state at the start of the step,
    # what the first kernel gives there, and the part of what N and U differ by that counts as their correction does.
    vectors: Floats = sized("n_factored + size + n_ends + 1")
    factors: Floats = sized("n_factored", of="vectors")
    begun: Floats = sized("size", of="vectors", at="n_factored")
    start: Floats = sized("n_ends", of="vectors", at="n_factored + size")
    share: Floats = sized("1", of="vectors", at="n_factored + size + n_ends")
    before: Matrix = sized("m", "k")
    vector: Matrix = sized("2 * n_factors", "n_matrix")
    defects: Floats = sized("m")
    ratio: Floats = sized("1")  # this step over the last
    sums: Floats = sized("n + 3 * m + 1")  # what `formulas.closing` writes, and `any_vectors.defect`
    end: Floats = sized("n_ends")  # what the first kernel gives at the end of the step
    laws: Floats = sized("n_laws")  # a state, its energy, energy and invariants that it should have
    now: Floats = sized("n_laws")  # the same of the start of a step
    run: Floats = sized("2")  # the energy at the start of the run, and its round-off
    mended: Floats = sized("n_mended")
    # Iterations that a unit of time is worth, that may be owed, the count at which an attempt is given up, and what a
    # step takes beside its own: see march.advance.
    budget: Floats = sized("4")
    whole_from: Floats = sized("1")  # the step from which on the whole matrix is taken at once
    seen: Floats = sized("3")  # the contraction of the last solve, the quadrature that it took, its last correction
    at_nodes: Matrix = sized("k", "n_nodes")  # rates of positions and others, both, projected slopes
    drift: Matrix = sized("k", "n_carried")  # rates of what is carried
    at_points: Matrix = sized("MOST_POINTS", "n_carried")
    slopes: Matrix = sized("MOST_POINTS", "n_slopes")
    FG: Floats = sized("size")
    x0: Floats = sized("n_carried", of="start", at="2 * m + 2")  # what is carried, at the start
    # of the block: its entries, and a bound of its rates
    entries: Floats = sized("n_ends - n_carried - 2 * m - 2", of="start", at="2 * m + 2 + n_carried")
    dz: Floats = sized("size")
    z1: Floats = sized("size")
    z: Floats = sized("size")  # of a run: where it is
    carry: Floats = sized("size")  # and what rounding dropped on the way
    here: Floats = sized("size")  # of a march: where it is
    dropped: Floats = sized("size")  # and what rounding dropped on the way
    watch: Floats = sized("2")  # how far an adaptive run is, and whether it is to end: see `records.Lending`
    rows: int  # what follows is lent for a run
    times: Floats = sized("rows")
    states: Matrix = sized("rows", "size")  # at these times, the first given
