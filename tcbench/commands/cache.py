"""`tcbench cache`: where compiled code and references are kept, how much, and away with them."""

from __future__ import annotations

from dataclasses import asdict

import click

from .. import cache
from .examples import Command


@click.command("cache", cls=Command)
@click.argument("action", required=False, type=click.Choice(["clear"]))
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def cache_command(action: str | None, as_json: bool) -> None:
    """Where compiled code and references are kept, how large that is, and how large it may get.

    "tcbench cache clear" removes them; they are made again when they are needed. TCBENCH_CACHE_DIR chooses another
    folder, TCBENCH_CACHE_LIMIT another limit in MiB.
    """
    usage = cache.clear() if action == "clear" else cache.usage()
    if as_json:
        from .terminal import print_json

        print_json(asdict(usage) | {"folder": str(usage.folder)})
        return
    files, size = f"{usage.files} file{'' if usage.files == 1 else 's'}", usage.bytes / 2**20
    if action == "clear":
        click.echo(f"Removed {files}, {size:.1f} MiB, from {usage.folder}")
        return
    click.echo(usage.folder)
    click.echo(f"{files}, {size:.1f} of {usage.limit / 2**20:.0f} MiB; what was not used for longest goes first.")
    click.echo("tcbench cache clear removes them all.")
