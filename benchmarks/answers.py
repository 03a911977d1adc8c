"""The short answers of README and docs/choose-a-method.md, from a run: python benchmarks/answers.py results/latest

Writes the blocks between their <!-- answers --> marks.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", ROOT / "docs" / "choose-a-method.md")
BEGIN, END = "<!-- answers -->\n", "<!-- /answers -->"
LEAST = 1e-5  # an error that no reader needs the digits of
COARSE = ("tc_gauss", "tc_strang_exact", "tc_monolithic", "tc_staggered", "tc_strang", "tc_gonzalez",
          "midpoint_entropy", "midpoint_temperature")  # fmt: skip


def collect(folder):
    """What the answers are made of: the page's sentences, and errors at the coarsest step by scenario."""
    from tcbench.report.overview import findings
    from tcbench.report.page_data import cells
    from tcbench.report.pairs import pairs
    from tcbench.runner.rows import Store
    from tcbench.runner.tables import read_tables

    store = Store.read(folder)
    tables, manifest = read_tables(store), store.manifest()
    found = pairs(tables, store.declared())
    heat, made = cells(found, "coarse"), cells(found, "produced")
    return {
        "machine": manifest["machine"]["cpu"], "version": manifest["tcbench"],
        "ended": str(manifest["ended"])[:10],
        "sentences": [(*one[:3], one.more) for one in findings(found, tables, store.declared())],
        "ladder": coarsest(tables["work_precision"]),
        "coarse": {m: {"temperatures": heat[m], "entropy": made.get(m, {})} for m in COARSE if m in heat},
    }  # fmt: skip


def coarsest(work):
    """Of the runs with the coarsest fixed step: step and horizon by scenario, microseconds a step by method."""
    rows = work[work["control"].eq("dt")]
    rows = rows[rows["value"] >= (1 - 1e-9) * rows.groupby("scenario")["value"].transform("max")]
    done = rows[rows["status"].eq("ok")]
    cost = (1e6 * done["wall_time_min_s"] / done["steps"]).groupby(done["integrator"]).agg(["median", "max"])
    spans = rows.groupby("scenario")[["value", "t"]].max()
    return {
        "spans": {s: [float(f"{h:.3g}"), float(f"{t:.3g}")] for s, h, t in spans.itertuples()},
        "us_per_step": {m: [float(f"{v:.2g}") for v in cost.loc[m]] for m in COARSE if m in cost.index},
    }


def short(kept, whole=False):
    """README: one number a question; whole: with what stands behind it."""
    rows = [f"| {title} | **{lead}** | {'; '.join([text, *more] if whole else [text])} |"
            for title, lead, text, more in kept["sentences"]]  # fmt: skip
    return "\n".join(["| question | answer | measured |", "|---|---|---|", *rows, "", origin(kept), ""])


def long(kept):
    """docs: with what stands behind each, and what a coarse step costs by scenario."""
    scenarios = sorted({s for of in kept["coarse"].values() for s in of["temperatures"]})
    spans, cost = kept["ladder"]["spans"], kept["ladder"]["us_per_step"]
    lines = [
        short(kept, whole=True),
        "Error of the final temperatures / of the entropy produced at the coarsest step, per cent (x: failed, -: not "
        "measured, 0: below 0.001); the worse of both on the worst scenario; microseconds a step, in the median and on "
        "the dearest scenario, where Newton's method has to be helped. At a late t everything has relaxed, and "
        "temperatures are right whatever the way there was.",
        "",
    ]
    lines += [f"| | {' | '.join(scenarios)} | worst | µs a step |", "|---" * (len(scenarios) + 3) + "|"]
    lines.append(f"| h, t | {' | '.join('{:g}, {:g}'.format(*spans[s]) for s in scenarios)} | | |")
    for name, of in kept["coarse"].items():
        cells = [f"{percent(of['temperatures'].get(s, ''))} / {percent(of['entropy'].get(s, ''))}" for s in scenarios]
        errors = [x for kind in of.values() for s, x in kind.items() if s in scenarios]
        worst = "x" if None in errors else percent(max(errors))
        lines.append(f"| `{name}` | {' | '.join(cells)} | {worst} | {' / '.join(map('{:g}'.format, cost[name]))} |")
    return "\n".join([*lines, ""])


def percent(value):
    small = isinstance(value, float) and value < LEAST
    return {None: "x", "": "-"}.get(value) or ("0" if small else f"{100 * value:.2g}")


def origin(kept):
    run = f"One `tcbench run --all` of {kept['version']} on {kept['machine']}, {kept['ended']}"
    return f"{run} (`python benchmarks/answers.py FOLDER`)."


if __name__ == "__main__":
    found = collect(sys.argv[1])
    for page in PAGES:
        before, rest = page.read_text().split(BEGIN)
        block = (short if page.name == "README.md" else long)(found)
        page.write_text(before + BEGIN + block + END + rest.split(END, 1)[1])
