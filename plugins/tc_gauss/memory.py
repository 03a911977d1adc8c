"""The workspaces (records) of the collocation: every array of a step with its shape; the notation is that of `step`."""

from __future__ import annotations

from tcbench.compiler.kernels import WIDTH  # noqa: F401  (of the shapes)
from tcbench.compiler.language import Address, Cube, Floats, Matrix
from tcbench.compiler.polling import SIZE  # noqa: F401  (of the shapes)
from tcbench.compiler.records import Record, sized

from .sparse import Sparse

# points of the quadratures, whole numbers of vectors: the coarsest that keeps the energy is taken
POINTS = (8, 16, 32, 64)
ON_VECTORS = 2  # of them: steps that need more are too long for the iteration
LONG = 4096.0  # a time beyond is counted in a small unit
SOLVED_TO = 0.01  # of the tolerance: residual of the collocation equations in adaptive runs
LEVELS, MOST_POINTS = len(POINTS), POINTS[-1]


class Counts(Record, mutable=True):
    """What steps cost."""

    steps: int
    rejected: int
    iterations: int
    halved: int
    raised: int


class Budget(Record, mutable=True):
    """What an adaptive run may cost, in iterations: see `march.advance`."""

    worth: float  # of a unit of time
    most: float  # that may be owed
    limit: float  # count at which an attempt is given up
    t: float  # where a run ended


class Solve(Record, mutable=True):
    """How the equations of a step are solved, and what that showed."""

    stiff: bool  # with the factors of a Jacobian
    whole: bool  # of all variables, in the loops, although there are kernels on vectors
    factored: bool  # its factors are made
    contraction: float  # of the iteration
    level: int  # of the quadrature
    leaves: bool  # constraints by the error of a step, as fixed ones do


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
    """The arrays of one step of k stages and m variables. Row i of U and N holds variable i at WIDTH nodes, of which k
    are used."""

    k: int
    m: int
    n_constants: int
    n_ends: int
    constrained: bool
    n_kinks: int  # the last ones of these: see `formulas.kinks_of`
    n_jumping: int
    n_factors: int
    n_lanes: int  # m where the iteration is on vectors, else 0
    n_own: int  # of these the variables that it solves for
    n_nodes: int  # what stands in a row of these
    n_carried: int
    n_slopes: int
    n_laws: int
    n_mended: int
    least_energy: float  # by what energies are measured at least
    to_start: Address  # see `formulas.Formulas`
    to_motion: Address
    to_slopes: Address
    to_forces: Address
    to_matrix: Address
    to_laws: Address
    to_mend: Address  # see `solver.mending`
    to_hold: Address
    to_factor: Address  # those on vectors, or 0: see `vectors`
    to_damp: Address
    to_iterate: Address
    to_iterate_finer: Address
    to_extrapolate: Address
    to_close: Address
    numbers: Numbers
    sparse: Sparse  # the Jacobian
    large: bool  # by formulas on arrays
    counts: Counts
    budget: Budget
    solve: Solve
    c: Floats = sized("n_constants")  # the time step, the system's constants, and what depends on them only
    found: Floats = sized("2 * WIDTH * m + 1")
    U: Matrix = sized("m", "WIDTH", of="found")  # the iterate
    N: Matrix = sized("m", "WIDTH", of="found", at="WIDTH * m")  # the rates that it gives
    rates: Floats = sized("WIDTH * m", of="found", at="WIDTH * m")  # the same
    kept: Floats = sized("WIDTH * m")  # those of the last step that was taken
    # What `vectors.iteration` reads: z, weights, what is carried of z; then factors.
    vectors: Floats = sized("2 * n_lanes + n_carried + 2 * WIDTH * n_own * n_own")
    weights: Floats = sized("n_lanes", of="vectors", at="n_lanes")
    carried: Floats = sized("n_carried", of="vectors", at="2 * n_lanes")
    factors: Floats = sized("2 * WIDTH * n_own * n_own", of="vectors", at="2 * n_lanes + n_carried")
    acts: Floats = sized("n_lanes")  # 1 where a variable is among those that it solves for, else 0
    sides: Matrix = sized("m", "WIDTH")  # defects at both ends
    before: Matrix = sized("m", "k")
    vector: Matrix = sized("2 * n_factors", "m")
    ratio: Floats = sized("1")  # this step over the last
    sums: Floats = sized("3 * m")  # what `vectors.closing` writes
    start: Floats = sized("n_ends")  # what the first kernel gives at the start of the step: rates, then these parts
    inverse_sizes: Floats = sized("m", of="start", at="m")
    start_energy: Floats = sized("1", of="start", at="2 * m")
    start_y: Floats = sized("n_carried", of="start", at="2 * m + 1")
    end: Floats = sized("n_ends")  # the same at its end
    end_energy: Floats = sized("1", of="end", at="2 * m")
    inside: Matrix = sized("3", "n_ends")  # the same at two nodes of the step, and between them
    laws: Floats = sized("n_laws")  # a state and the laws that it should have, as `solver.mending` has them
    run: Floats = sized("1", of="laws", at="m")  # the energy at the start of the run
    least_entropy: Floats = sized("1", of="laws", at="m + 1")
    miss: Floats = sized("1", of="laws", at="m + 3")  # what the energy may miss
    now: Floats = sized("n_laws")  # the same of another state
    now_miss: Floats = sized("1", of="now", at="m + 3")
    mended: Floats = sized("n_mended")
    at_nodes: Matrix = sized("k", "n_nodes")  # rates, state, projected slopes
    drift: Matrix = sized("k", "n_carried")  # rates of what is carried
    at_points: Matrix = sized("MOST_POINTS", "n_carried")
    slopes: Matrix = sized("MOST_POINTS", "n_slopes")
    forces: Floats = sized("m")  # rates at a node
    dz: Floats = sized("m")
    z1: Floats = sized("m")
    z: Floats = sized("m")  # of a run: where it is
    carry: Floats = sized("m")  # and what rounding dropped on the way
    here: Floats = sized("m")  # of a march: where it is
    dropped: Floats = sized("m")  # and what rounding dropped on the way
    watch: Floats = sized("SIZE")  # of an adaptive run, lent for it: see `tcbench.compiler.polling`
    rows: int  # what follows is lent for a run
    times: Floats = sized("rows")
    states: Matrix = sized("rows", "m")  # at these times, the first given
