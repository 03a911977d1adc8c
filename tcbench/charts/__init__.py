"""Charts: a table in, a matplotlib Figure out. No pyplot, no computing, no saving, no conclusions in titles."""

from .ladders import blowup, conservation, stable_step
from .precision import convergence, work_precision
from .runs import equilibrium, four_panel, history, laws, path
from .style import look

__all__ = [
    "blowup", "conservation", "convergence", "equilibrium", "four_panel", "history", "laws", "look", "path",
    "stable_step", "work_precision",
]  # fmt: skip
