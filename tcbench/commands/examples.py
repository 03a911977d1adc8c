"""What `--help` ends with: examples that run as they stand, and of `plot` the kinds of charts."""

from __future__ import annotations

import click

EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": (
        "tcbench run --all",
        "tcbench run -i 'tc_*' -s stiff_spring --study conservation --dt 0.3 -o results/mine",
        "tcbench run -i mine -i tc_monolithic -s short_term --study conservation --plugins-dir .",
    ),
    "list": ("tcbench list", "tcbench list -i tc_strang --json"),
    "simulate": (
        "tcbench simulate midpoint_entropy short_term --dt 0.5 --csv run.csv",
        "tcbench simulate tc_auto short_term --tolerance 1e-9",
    ),
    "map": ("tcbench map midpoint_entropy stiff_spring --x dt=0.05:2:8:log --y stiffness=0.1:2:4:log -o results/map",),
    "reference": ("tcbench reference short_term",),
    "data": (
        "tcbench data short_term --starts 50 --every 0.3 --t-end 60 -o pendulum.npz",
        "tcbench data short_term --judge pendulum.npz",
    ),
    "show": ("tcbench show results/latest", "tcbench show results/latest --table conservation -s long_term"),
    "report": ("tcbench report results/latest", "tcbench report results/published results/mine -o both.html"),
    "plot": ("tcbench plot conservation results/latest -s long_term -o errors.svg --size 15x10cm",),
    "animate": ("tcbench animate midpoint_entropy tc_monolithic stiff_spring --dt 0.3 --t-end 6 -o blowup.gif",),
    "paper": ("tcbench paper -o results/paper --format svg",),
    "publish": ("tcbench publish results/latest results/other -o site",),
    "compare": ("tcbench compare results/before results/latest --fail-on-regression",),
    "new": ("tcbench new integrator mine", "tcbench new system pump --package --folder ~/work"),
    "cache": ("tcbench cache", "tcbench cache clear"),
    "check": ("tcbench check mine.py", "tcbench check -i tc_strang --only order,claims"),
}


class Command(click.Command):
    """A command whose help ends with examples."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_epilog(ctx, formatter)
        if self.name == "plot":
            from ..report.chart_kinds import kinds

            with formatter.section("Kinds"):
                formatter.write_dl([(name, kind.text) for name, kind in kinds().items()])
        if examples := EXAMPLES.get(self.name or ""):
            formatter.write_paragraph()
            formatter.write("Examples:\n" + "".join(f"  {line}\n" for line in examples))
