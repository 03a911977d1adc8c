"""What methods and scenarios say of themselves, as data in the run folder: a report needs no plugins to tell it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import plugins
from ..errors import TcbenchError
from ..integrator import Integrator
from ..simulation import fields
from ..study import Study
from ..systems.plane import joints, links
from ..systems.scenario import Scenario

FAMILIES = ("Romero (2009)", "consistent, beyond the paper", "other structure", "peers")
PAPER = FAMILIES[0]
LONGEST = 4000  # characters of a formula or description that are kept
LAWS = {"energy", "entropy"}
RATES = "rates"
NUDGE = 1e-6  # of a number of the state, for slopes by differences


def declared(
    methods: Sequence[Integrator],
    scenarios: Sequence[Scenario],
    absent: Mapping[str, str],
    studies: Sequence[Study] = (),
) -> dict[str, dict[str, Any]]:
    """The methods, scenarios, metrics and tables of plugins of a run by name, and methods that lack a package with its
    name."""
    return {
        "integrators": {method.name: method_facts(method) for method in methods},
        "scenarios": {scenario.name: scenario_facts(scenario) for scenario in scenarios},
        "metrics": {
            m.name: {n: getattr(m, n) for n in ("unit", "description", "label", "worse")}
            for m in plugins.metrics().values()
        },
        "tables": {study.name: [table.as_dict() for table in study.tables] for study in studies if study.plugin},
        "absent": dict(absent),
    }


def method_facts(method: Integrator) -> dict[str, Any]:
    """What a method declares, with its formulas as its author wrote them."""
    functions = _formulas(method)
    text = "\n\n".join(filter(None, dict.fromkeys(_source(f) for f in functions)))
    return {
        "family": family(method), "kind": method.kind, "order": method.order, "claims": sorted(method.claims),
        "source": method.source, "tags": sorted(method.tags), "plugin": method.plugin,
        "description": (method.description or _docstring(method))[:LONGEST], "formula": text[:LONGEST],
    }  # fmt: skip


def family(method: Integrator) -> str:
    """The paper's own methods, others that keep its laws, those with other structure, and solvers to compare with.

    A discrete gradient in the paper's frame is of the second family even where its energy is exact up to quadrature.
    """
    if "peer" in method.tags:
        return FAMILIES[3]
    if method.source.startswith(PAPER) and not method.systems:
        return PAPER
    return FAMILIES[1] if method.claims >= LAWS or "gradient" in method.tags else FAMILIES[2]


def _formulas(method: Integrator) -> list[Any]:
    """The functions that say what the method is: its residuals, its step, or its solver."""
    return [flow.residual for flow in method.flows] if method.flows is not None else [method.step or method.adaptive]


def _source(function: Any) -> str:
    try:
        return inspect.cleandoc("\n" + inspect.getsource(inspect.unwrap(function)))
    except (OSError, TypeError, ValueError):
        return ""  # written at a prompt, or not in Python


def _docstring(method: Integrator) -> str:
    """Of the plugin's file, which says what its methods are; of the formula for a method that no plugin brought."""
    origin = plugins.registry().origins.get(method.plugin)
    if origin is not None and origin.path:
        try:
            return ast.get_docstring(ast.parse(Path(origin.path).read_text("utf-8"))) or ""
        except (OSError, ValueError, SyntaxError):
            return ""
    function = _formulas(method)[0]
    return (inspect.getdoc(function) if inspect.isfunction(function) else None) or ""


def scenario_facts(scenario: Scenario) -> dict[str, Any]:
    """The data of a scenario, its invariants, and which masses its elements join in the plane (if they do), which
    joints the lines of its own picture, or which places the faces of its mesh, as the table `fields` numbers them."""
    z0, model = scenario.z0, scenario.model
    mesh = fields.faces_of(model, np.asarray(z0))
    return scenario.as_dict() | {
        "dt": scenario.dt, "t_converge": scenario.t_converge, "ladder": list(scenario.ladder), "shows": scenario.shows,
        "source": scenario.source, "plugin": scenario.plugin, "initial_exergy": float(scenario.initial_exergy),
        "initial_energy": float(model.energy(z0)), "invariants": list(model.invariant_names),
        "links": links(model), "joints": joints(model, z0)[0],
        "faces": mesh[2].tolist() if mesh else [], RATES: rates(scenario),
    }  # fmt: skip


def rates(scenario: Scenario) -> list[float] | None:
    """The fastest decay and the fastest oscillation at the start: of eigenvalues x of the Jacobian the largest -Re x
    and |Im x|, in the scenario's unit of time, to three digits; None of large systems and where there is no Jacobian.

    By differences, which have these digits: the exact Jacobian would be compiled for them, in the process that waits.
    """
    model, z0 = scenario.model, np.asarray(scenario.z0)
    if model.large:
        return None
    sizes = NUDGE * np.maximum(model.state_magnitudes, np.abs(z0))
    try:
        columns = [(model.vector_field(z0 + d) - model.vector_field(z0 - d)) / (2 * d.max()) for d in np.diag(sizes)]
        x = np.linalg.eigvals(np.array(columns, dtype=float).T)
    except (ArithmeticError, TcbenchError, np.linalg.LinAlgError):
        return None
    return [float(f"{value:.3g}") for value in (max(0.0, -x.real.min()), np.abs(x.imag).max())]


def merged(earlier: Mapping[str, Any], later: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """What a folder says after another run into it: names of both, the later word on each."""
    parts = ("integrators", "scenarios", "metrics", "tables", "absent")
    first = [{k: v for k, v in run.items() if isinstance(v, Mapping)} for run in (earlier, later)]
    return {key: {**first[0].get(key, {}), **first[1].get(key, {})} for key in parts}
