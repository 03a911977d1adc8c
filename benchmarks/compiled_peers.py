"""tc_auto beside the fastest peers, stiff ones with a compiled right-hand side among them: microseconds to an accuracy.

    python benchmarks/compiled_peers.py                    # the eight scenarios, to the horizons of work_precision
    python benchmarks/compiled_peers.py --lsoda FOLDER     # and LSODA in C++, from src/ of numbalsoda; needs g++

pip finds no wheel of numbalsoda for Python 3.11 to 3.13, and its own build asks for a Fortran compiler (for another
solver in it); its LSODA is two files of C++. Times are of the processor, the least of rounds in which all rungs take
turns.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import tcbench
from tcbench.plugins import find_integrator
from tcbench.reference.certified import gap
from tcbench.reference.lookup import reference_for
from tcbench.studies.work_precision import horizon
from tcbench.systems.right_hand_side import Field

METHODS = ("tc_auto", "tc_gauss_adaptive", "heyoka", "pydiffsol", "scipy_odeint", "scipy_dop853", "cvode")
SCENARIOS = ("short_term", "stiff_spring", "long_term", "bound_equilibrium", "cold_spring", "fast_conduction",
             "relative_equilibrium", "gas_containers")  # fmt: skip
TARGETS = (1e-3, 1e-6, 1e-9)
TOLERANCES = [10.0**-k for k in range(1, 14)]
ROUNDS, LONG_S = 12, 0.1  # a rung that takes longer is timed once, and no finer one
LIKELY, CLOSE = 3, 20.0  # rungs of a target that are timed again: so many of a method, so many times the fastest
WARM = 4  # runs of a rung in a round, of which the fastest counts: the first finds another method's data in the cache
ADAPTER = """
typedef void (*Kernel)(const double *, const double *, double *);
struct Field { Kernel kernel; const double *constants; long calls; };
void field(double t, double *u, double *du, void *data) {
    struct Field *f = data; f->calls++; f->kernel(u, f->constants, du);
}
"""


class FieldRecord(ctypes.Structure):
    _fields_ = (("kernel", ctypes.c_void_p), ("constants", ctypes.c_void_p), ("calls", ctypes.c_long))


def compiled_lsoda(source: Path):
    """adaptive(system, z0, times, rtol, atol) by the files of numbalsoda's src/."""
    folder = Path(tempfile.mkdtemp())
    (folder / "adapter.c").write_text(ADAPTER)
    flags = ["-O3", "-march=native", "-fPIC"]
    subprocess.run(["gcc", *flags, "-c", "adapter.c"], cwd=folder, check=True)
    files = [str((source / name).resolve()) for name in ("LSODA.cpp", "wrapper.cpp")]
    subprocess.run(["g++", *flags, "-shared", *files, "adapter.o", "-o", "lsoda.so"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "lsoda.so"))

    def adaptive(system, z0, times, rtol, atol):
        constants, start = np.ascontiguousarray(system.constant_values), np.ascontiguousarray(z0)
        record = FieldRecord(Field(system).rate_address, constants.ctypes.data, 0)
        when, found = np.ascontiguousarray(times, dtype=float), np.empty((len(times), len(start)))
        address = [ctypes.c_void_p(array.ctypes.data) for array in (start, when, found)]
        good = ctypes.c_int(0)
        library.lsoda_wrapper(
            ctypes.cast(library.field, ctypes.c_void_p), len(start), address[0], ctypes.byref(record), len(when),
            address[1], address[2], ctypes.c_double(rtol), ctypes.c_double(atol), 10_000_000, ctypes.byref(good),
            ctypes.c_bool(False),
        )  # fmt: skip
        if not good.value:
            raise RuntimeError("LSODA stopped")
        return found, {"rhs_evaluations": record.calls}

    return adaptive


def times_to(scenario: tcbench.Scenario, methods: dict) -> dict[str, list[float]]:
    """Seconds of the fastest rung of each method within each target; infinity where none is."""
    t_end = horizon(scenario)
    reference = reference_for(scenario, [t_end])
    ends, errors = np.array([0.0, t_end]), {}

    def run(name: str, tolerance: float):
        begin = time.process_time()
        states, _ = methods[name](scenario.model, scenario.z0.copy(), ends, tolerance, tolerance)
        return states, time.process_time() - begin

    took: dict[tuple[str, float], float] = {}
    for name in methods:
        for tolerance in TOLERANCES:
            try:
                run(name, tolerance)
                states, seconds = run(name, tolerance)
            except Exception as error:  # a solver that gives up is slower than any
                print(f"  {name} at {tolerance:g}: {str(error)[:80]}", file=sys.stderr)
                continue
            errors[name, tolerance], took[name, tolerance] = gap(states[-1], reference.states[-1]), seconds
            if errors[name, tolerance] <= TARGETS[-1] or seconds > LONG_S:
                break
    likely = set()
    for target in TARGETS:
        within = sorted((s, key) for key, s in took.items() if errors[key] <= target)
        for name in methods:
            likely |= set([key for s, key in within if key[0] == name and s <= CLOSE * within[0][0]][:LIKELY])
    for _ in range(ROUNDS):
        for key in likely:
            took[key] = min(took[key], *(run(*key)[1] for _ in range(WARM)))
    return {
        name: [min((s for (n, tol), s in took.items() if n == name and errors[n, tol] <= target), default=np.inf)
               for target in TARGETS]
        for name in methods
    }  # fmt: skip


def main() -> None:
    methods = {n: find_integrator(n).adaptive for n in METHODS if not find_integrator(n).lacks}
    if "--lsoda" in sys.argv:
        methods["LSODA in C++"] = compiled_lsoda(Path(sys.argv[sys.argv.index("--lsoda") + 1]))
    names = [n for n in SCENARIOS if n in sys.argv] or SCENARIOS
    for name in names:
        scenario = tcbench.scenarios()[name]
        found = times_to(scenario, methods)
        best = np.min([s for n, s in found.items() if not n.startswith("tc_")], axis=0)
        who = [min((s[i], n) for n, s in found.items() if not n.startswith("tc_"))[1] for i in range(len(TARGETS))]
        ratios = " / ".join(f"{r:.1f} ({n})" for r, n in zip(best / found["tc_auto"], who, strict=True))
        print(f"{name}: the best peer over tc_auto: {ratios}")
        for n, seconds in found.items():
            print(f"    {n:20}" + " / ".join(f"{1e6 * s:.0f}" if np.isfinite(s) else "-" for s in seconds), flush=True)


if __name__ == "__main__":
    main()
