"""pydiffsol: implicit solvers in Rust (diffsol), the formulas of the system in their language, compiled by LLVM.

Jacobians are by automatic differentiation of the compiled code: no step calls Python.
"""

import re

import numpy as np

from tcbench import Integrator, family, hookimpl
from tcbench.compiler.ops import rewritten

SOLVERS = ("bdf", "esdirk34", "tr_bdf2")  # the first is the default
FIRST_STEP = 1e-3  # of the tolerance's square root: the package's own, 1.0, lasts longer than a stiff start
NAMES = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}  # functions with another name in DiffSL
KNOWN = (*NAMES, "exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "abs", "pow")
LIMIT = 200  # length of a state: their compiler takes 50 s and 1.6 GB for it, and 4 min and 6 GB for twice as much
GIVEN_UP = "ODE solver error: "  # beginning of a message of a solver that gives up
_FREE = {}  # free solvers by kind of system: LLVM takes a second to make one


def program(system, own):
    """The formulas of the field in DiffSL; initial state and constants are inputs. One tolerance is for all numbers:
    where magnitudes differ from 1, each number is divided by its own."""
    text, (size,) = system.formula("vector_field")
    count = len(system.constant_values)
    first = count - len(system.magnitudes)
    each = [f"c{first + k}" for k, (a, b, _) in enumerate(system.layout.values()) for _ in range(a, b)]
    lines, out = [] if own else [f"y{i} {{ x{i} * {each[i]} }}" for i in range(size)], {}
    letter = "x" if own else "y"
    for line in rewritten(text, KNOWN).splitlines()[1:]:
        name, _, formula = (part.strip() for part in line.partition("="))
        formula = re.sub(r"\ba\[(\d+)\]", rf"{letter}\1", re.sub(r"\bb\[(\d+)\]", r"c\1", formula))
        formula = re.sub(r"\b(a\w+)\(", lambda call: f"{NAMES.get(call[1], call[1])}(", formula)
        if name.startswith("out["):
            i = int(name[4:-1])
            out[i] = formula if own else f"({formula}) / {each[i]}"
        else:
            lines.append(f"{name} {{ {formula} }}")
    inputs = [f"z{i} = 1.0" for i in range(size)] + [f"c{i} = 1.0" for i in range(count)]
    state = [f"x{i} = z{i}" for i in range(size)]
    return "\n".join([
        f"in_i {{ {', '.join(inputs)} }}", f"u_i {{ {', '.join(state)} }}", *lines,
        f"F_i {{ {', '.join(out[i] for i in range(size))} }}",
    ])  # fmt: skip


def refuses(system):
    n = system.size
    reason = f"pydiffsol compiles a formula for each of the {n} numbers of {system.name}, at most {LIMIT}: take cvode"
    return reason if n > LIMIT else ""


def pydiffsol(solver="bdf"):
    def adaptive(system, z0, t_eval, rtol, atol):
        import pydiffsol as ds

        each = system.unit_sizes
        free = _FREE.setdefault((system.structure, solver, each is None), [])
        try:
            ode = free.pop()
        except IndexError:
            ode = ds.Ode(program(system, each is None), jit_backend=ds.llvm, ode_solver=getattr(ds, solver))
        ode.rtol, ode.atol, ode.t0 = rtol, atol, float(t_eval[0])
        ode.h0 = FIRST_STEP * np.sqrt(rtol) * float(t_eval[-1] - t_eval[0])
        try:
            times = np.ascontiguousarray(t_eval, dtype=float)
            start = z0 if each is None else z0 / each
            states = ode.solve_dense(np.concatenate([start, system.constant_values]), times).ys.T
        except RuntimeError as error:
            if not str(error).startswith(GIVEN_UP):
                raise
            raise ArithmeticError(f"diffsol {solver}: {error}") from error
        finally:
            free.append(ode)
        return np.ascontiguousarray(states if each is None else states * each), {}

    return Integrator(
        name="pydiffsol", adaptive=adaptive, refuses=refuses, source=f"diffsol {solver}", tags={"peer"},
        requires=["pydiffsol"],
    )  # fmt: skip


@hookimpl
def tcbench_integrators():
    return [family(pydiffsol, solver=SOLVERS)]
