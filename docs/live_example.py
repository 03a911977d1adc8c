"""mkdocs hook: the page of the published run, results/baseline, as it is now: site/example/report.html."""

from pathlib import Path

BASELINE = Path(__file__).parents[1] / "results" / "baseline"


def on_post_build(config):
    from tcbench.report.write_report import write_report

    folder = Path(config["site_dir"]) / "example"
    folder.mkdir(parents=True, exist_ok=True)
    write_report(BASELINE, page=folder / "report.html")
