"""The records of the compiled solvers: what one flow of a step is, and what a run counts."""

from __future__ import annotations

from ..compiler.language import Address, Floats, Matrix, ShortFloats, ShortInts
from ..compiler.records import Record, sized


class Tally(Record, mutable=True):
    """What a run counts, and extremes over its completed steps; dimensionless."""

    steps: int  # completed
    energy_error: float
    sum_t: float  # of a least-squares line through the energy error: in units of the step
    sum_tt: float
    sum_e: float
    sum_te: float
    entropy_min: float
    violations: int
    first_fall: int  # step; 0: none
    lyapunov_max: float
    residual_max: float
    iterations: int
    retried: int
    tracked: int
    tries: int
    arcs: int
    folds: int
    audited: int
    wrong_roots: int


class Extrapolation(Record, mutable=True):
    """What the last roots tell of the next one: see newton.foresee."""

    degree: int  # of the polynomial through them
    near: bool  # x is a guess for the next step
    curvature: float  # that an earlier step has shown; 0: unknown
    enough: float  # predicted error of the next root that ends `quick`, where more than round-off is


class OldFactors(Record, mutable=True):
    """Incomplete factors that go on from step to step: see quick_sparse."""

    made_in: float  # corrections with them in the step that made them; 0: there are none
    cost: float  # more corrections with them since then
    pause: float  # steps without
    stopped: float  # size of a correction that no longer shrank
    slowest: float  # contraction by incomplete factors that steps have shown
    noise: float  # size of a correction that is known to be round-off
    lost: float  # linear systems of this step that were not solved, and are too large to be factorised


class CompiledFlow(Record):
    """One flow of a method on one system: its kernels (see `flow_kernels`), rules, and what solvers write on."""

    n: int  # length of a state
    nx: int  # unknowns of Newton
    ne: int  # those that were eliminated
    npos: int  # temperatures among what `iterate` returns
    nd: int
    nw: int
    nj: int  # unknowns of a dense Jacobian, or 0
    ns: int  # those of a sparse one, or 0
    n_own: int  # of these the first, which are no shared numbers: see compiler.array_jacobian.shared_as_unknowns
    nnz: int  # entries of the sparse one
    krylov_steps: int  # of BiCGStab, after which the sparse matrix is factorised
    too_large: bool  # is it, to be factorised?
    nfull: int  # residual, Jacobian, d residual/dh
    n_constants: int
    n_observables: int
    most: int  # times that an explicit formula is applied
    prologue: Address
    iterate: Address
    polish: Address
    finish: Address
    full: Address
    observe: Address
    factorise: Address  # of a sparse Jacobian: see `Pattern`
    h: float  # its part of the step
    steep: bool  # slopes may be infinite where the equations are not: see linear_algebra.STEEPEST
    constrained: bool  # where the curve of roots begins is not 0: see systems.constrained
    foresees: bool  # Newton begins where the last roots point to: see newton.foresee
    continuation: bool  # the whole cascade; otherwise plain Newton
    audit: int  # see implicit_step
    residuals: bool
    reference: float  # temperature of the exergy
    least_energy: float  # by what energies and entropies are measured at least
    least_entropy: float
    bound: float  # V0
    tally: Tally
    c: Floats = sized("n_constants")  # step, constants; of a run's flows one array
    start: Floats = sized("n")  # state from which the careful solvers begin
    w: Floats = sized("nw")  # what stays fixed during Newton: see `FlowKernels`. Its parts, before what is hoisted:
    at_rest: Floats = sized("nx", of="w")  # unknowns of z1 = z0
    guess: Floats = sized("nx", of="w", at="nx")  # nearer ones
    inverse_sizes: Floats = sized("nx + ne", of="w", at="2 * nx")
    x: Floats = sized("nx")
    d: Floats = sized("nd")  # what `iterate` gives, of a sparse Jacobian what is made of that: a correction, then
    pivots: Floats = sized("nx", of="d", at="nx + ne")
    temperatures: Floats = sized("npos", of="d", at="2 * nx + ne")
    size_and_least: Floats = sized("2", of="d", at="2 * nx + ne + npos")  # of the correction, of what must be positive
    polished: Floats = sized("1", of="d", at="nx + ne")  # what `polish` gives: behind a correction, its size
    past: Matrix = sized("nx", "9")  # the last root of each unknown, and its backward differences
    foreseen: Extrapolation
    dz: Floats = sized("n")
    scale: Floats = sized("nx + ne")  # 1/size of the unknowns
    derivatives: Floats = sized("nfull")  # what `full` gives, and of a sparse Jacobian `iterate` and `polish`
    residual: Floats = sized("nx", of="derivatives")
    jacobian: Matrix = sized("nj", "nj", of="derivatives", at="nx")
    by_h: Floats = sized("nj", of="derivatives", at="nx + nj * nj")
    entries: Floats = sized("nnz", of="derivatives", at="nx")  # of a sparse Jacobian
    old: Floats = sized("nx")  # the root before the last one on the way in h
    last: Floats = sized("nx")  # root on the way
    accepted: Floats = sized("n")
    seen: Matrix = sized("2", "n_observables")
    points: Matrix = sized("4", "nx + 1")  # of the arc
    bordered: Matrix = sized("nj + 1", "nj + 3")  # a Jacobian with a border, and right-hand sides
    correction: Floats = sized("nx + 1")  # of the arc's corrector
    direction: Floats = sized("nx + 1")  # of its tangent, not normalised
    shift: Floats = sized("nx")  # of a detour; else 0
    first: ShortInts = sized("ns + 1")  # a sparse Jacobian: see `Pattern`
    columns: ShortInts = sized("nnz")
    diagonal: ShortInts = sized("ns")
    order: ShortInts = sized("ns")
    place: ShortInts = sized("ns")  # what is written on
    factors: ShortFloats = sized("nnz")
    kept: OldFactors
    krylov: Matrix = sized("8", "ns")
    solved: Floats = sized("2 * ns + 1")
