"""The workspaces (records) of the collocation: every array of a step with its shape; the notation is that of `step`."""

from __future__ import annotations

from tcbench.compiler.kernels import WIDTH  # noqa: F401  (of the shapes)
from tcbench.compiler.language import Address, Cube, Floats, Matrix
from tcbench.compiler.looks import SIZE  # noqa: F401  (of the shapes)
from tcbench.compiler.records import Record, sized

from .sparse import Sparse

# points of the quadratures, whole numbers of vectors: the coarsest that keeps the energy is taken
POINTS = (8, 16, 32, 64)
LONG = 4096.0  # a time beyond is counted in a small unit
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
    A_squared: Matrix = sized("k", "k")
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
    """The arrays of one step; k stages, n positions, e elements, m = n + e rates.

    Row i of `found` holds variable i at WIDTH nodes, of which k are used: U, N, V and rates are parts of it. What
    `formulas.iteration` reads, `given`, has parts as well. The conduction is stiff: a matrix of rank one in N'(U),
    u v^T x hA; its block (I - lambda hA)^-1 hA, lambda = v . u, stands by columns.
    """

    n: int
    e: int
    k: int
    m: int
    n_constants: int
    n_newton: int  # unknowns of Newton's method, which is for small systems; 0: none
    n_ends: int
    n_kinks: int  # the last ones of these: see `formulas.kinks_of`
    n_matrix: int  # elements whose conduction is solved for as a whole (see conduction.py), or 0
    n_factors: int
    n_lanes: int  # variables of any system whose iteration is on vectors, or 0
    n_nodes: int  # what stands in a row of these
    n_carried: int
    n_slopes: int
    n_positive: (
        int  # of the carried the first ones, and of the slopes the last ones: shapes and temperatures of springs
    )
    n_laws: int
    n_mended: int
    least_p: float  # of springs, by what momenta are measured at least, and entropies; and of all, energies
    least_s: float
    least_energy: float
    general: bool  # of any system: see any_system.py; then n = 0, and all variables are in the place of entropies
    to_start: Address  # see `formulas.Formulas`
    to_motion: Address
    to_slopes: Address
    to_forces: Address
    to_mend: Address
    to_hold: Address  # of any system: see solver.mending
    to_laws: Address
    to_matrix: Address  # of the conduction; 0: none
    to_iterate: Address  # those on vectors; 0: none
    to_iterate_finer: Address
    to_block: Address
    to_factor: Address  # of any system on vectors: see any_vectors.py
    to_damp: Address
    to_extrapolate: Address
    to_close: Address
    numbers: Numbers
    sparse: Sparse  # the matrix of the conduction: see conduction.py
    large: bool  # by formulas on arrays
    counts: Counts
    c: Floats = sized("n_constants")  # the time step, the system's constants, and what depends on them only
    inverse_mass: Floats = sized("n")
    given: Floats = sized("2 * m + k * WIDTH + 2 * e + 2")
    state0: Floats = sized("2 * m", of="given")  # q, p, pi and s at the start of the step
    block: Floats = sized("k * WIDTH", of="given", at="2 * m")  # of the conduction, by columns
    columns: Matrix = sized("k", "WIDTH", of="block")  # the same
    u: Floats = sized("e", of="given", at="2 * m + k * WIDTH")  # left and right of the conduction
    v: Floats = sized("e", of="given", at="2 * m + k * WIDTH + e")
    scale: Floats = sized("2", of="given", at="2 * m + k * WIDTH + 2 * e")  # of forces and of heat in a residual
    found: Floats = sized("WIDTH * (2 * m + n) + 1")
    U: Matrix = sized("m", "WIDTH", of="found")  # the iterate
    N: Matrix = sized("m", "WIDTH", of="found", at="WIDTH * m")  # the rates that it gives
    V: Matrix = sized("n", "WIDTH", of="found", at="WIDTH * 2 * m")  # velocities
    rates: Floats = sized("WIDTH * (m + n)", of="found", at="WIDTH * m")  # N, then V
    kept: Floats = sized("WIDTH * (m + n)")  # those of the last step that was taken
    # h, lambda, 1 where conduction.py solves for the conduction, 1 if its own factors are made beside those on vectors
    stiff: Floats = sized("4")
    # What `any_vectors.iteration` reads: z, weights, what is carried of z; then factors.
    vectors: Floats = sized("2 * n_lanes + n_carried + 2 * WIDTH * n_lanes * n_lanes")
    weights: Floats = sized("n_lanes", of="vectors", at="n_lanes")
    carried: Floats = sized("n_carried", of="vectors", at="2 * n_lanes")
    factors: Floats = sized("2 * WIDTH * n_lanes * n_lanes", of="vectors", at="2 * n_lanes + n_carried")
    sides: Matrix = sized("n_lanes", "WIDTH")  # defects at both ends
    before: Matrix = sized("n_matrix", "k")
    vector: Matrix = sized("2 * n_factors", "n_matrix")
    defects: Floats = sized("n_matrix")
    ratio: Floats = sized("1")  # this step over the last
    sums: Floats = sized("n + 3 * m")  # what `formulas.closing` writes
    start: Floats = sized("n_ends")  # what the first kernel gives at the start of the step: rates, then these parts
    inverse_sizes: Floats = sized("m", of="start", at="m")  # of any system
    start_energy: Floats = sized("2", of="start", at="n + 2 * e")  # the energy, and its round-off
    start_y: Floats = sized("n_carried", of="start", at="n + 2 * e + 2")  # of any system
    decay: Floats = sized("1", of="start", at="n + 2 * e + 2")  # of elements, of two of them: lambda, u and v
    start_u: Floats = sized("e", of="start", at="n + 2 * e + 3")
    start_v: Floats = sized("e", of="start", at="n + 3 * e + 3")
    end: Floats = sized("n_ends")  # the same at its end
    inside: Matrix = sized("2", "n_ends")  # the same at two nodes of the step
    end_energy: Floats = sized("2", of="end", at="n + 2 * e")
    laws: Floats = sized("n_laws")  # a state, its energy, energy and invariants that it should have
    least_entropy: Floats = sized("1", of="laws", at="m + 1")  # of any system, as `solver.mending` has it
    now: Floats = sized("n_laws")  # of any system: the same of the start of a step
    run: Floats = sized("1")  # the energy at the start of the run
    mended: Floats = sized("n_mended")  # what the fifth kernel makes of them
    # Iterations that a unit of time is worth, that may be owed, the count at which an attempt is given up, and what a
    # step takes beside its own: see march.advance.
    budget: Floats = sized("4")
    seen: Floats = sized("2")  # the contraction of the last solve, and the quadrature that it took
    at_nodes: Matrix = sized("k", "n_nodes")  # velocities, positions, stresses, temperatures
    drift: Matrix = sized("k", "n_carried")  # rates of shapes and entropies
    at_points: Matrix = sized("MOST_POINTS", "n_carried")  # shapes and entropies
    slopes: Matrix = sized("MOST_POINTS", "n_slopes")  # stresses and temperatures
    FG: Floats = sized("m")
    rho: Floats = sized("k")
    J: Matrix = sized("n_newton", "n_newton + 1")  # and the right-hand side
    rhs: Floats = sized("n_newton")
    base: Floats = sized("n_newton")
    x0: Floats = sized("n_carried")  # shapes and entropies at the start
    dz: Floats = sized("n + m")
    z1: Floats = sized("n + m")
    z: Floats = sized("n + m")  # of a run: where it is
    carry: Floats = sized("n + m")  # and what rounding dropped on the way
    here: Floats = sized("n + m")  # of a march: where it is
    dropped: Floats = sized("n + m")  # and what rounding dropped on the way
    watch: Floats = sized("SIZE")  # of an adaptive run, lent for it: see `tcbench.compiler.looks`
    rows: int  # what follows is lent for a run
    times: Floats = sized("rows")
    states: Matrix = sized("rows", "n + m")  # at these times, the first given
