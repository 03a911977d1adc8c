"""Writes docs/command-line.md from the commands themselves: python docs/command_line.py (a test compares)."""

from pathlib import Path

import click

from tcbench.cli import main
from tcbench.commands.examples import EXAMPLES

PAGE = Path(__file__).with_name("command-line.md")
HEAD = """# Command line

Every command, as `tcbench COMMAND --help` tells it. Exit codes: 0 all is well; 1 what was asked for came out badly
(`--strict`, `--fail-on-regression`, a line of `check`); 2 the input is wrong, and one sentence says how; 130 Ctrl-C.
Tables can be had as JSON with `--json`. This page is written by `python docs/command_line.py`.
"""


def section(name: str, command: click.Command) -> str:
    """One command; written from its parts, so that every version of click gives the same page."""
    arguments = [p.metavar or (p.name or "").upper() for p in command.params if isinstance(p, click.Argument)]
    lines = [f"\n## {name}\n", " ".join((command.help or "").split()), ""]
    lines += ["```text", " ".join(["tcbench", name, "[OPTIONS]", *arguments]), "```", ""]
    lines += ["| option | meaning |", "|---|---|"]
    lines += [option(p) for p in command.params if isinstance(p, click.Option)]
    lines += ["", "```text", *EXAMPLES[name], "```"]
    return "\n".join(lines) + "\n"


def option(p: click.Option) -> str:
    names = ", ".join([*p.opts, *p.secondary_opts])
    kind = "" if p.is_flag else " " + (p.metavar or p.type.name.upper().removesuffix(" RANGE"))
    choices = f" One of {', '.join(p.type.choices)}." if isinstance(p.type, click.Choice) else ""
    default = f" Default: {p.default}." if p.show_default else ""
    return f"| `{names}{kind}` | {' '.join((p.help or '').split())}{choices}{default} |"


def page() -> str:
    return HEAD + "".join(section(name, main.commands[name]) for name in main.commands)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
