"""The group of commands: what a user can cure is one sentence and an exit code, never a traceback."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any

import click

from ..errors import TcbenchError, unknown_name, visible
from .examples import Command
from .options import one_sentence

UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)  # what a full disk says of stdout


class Group(click.Group):
    """Turns errors that a user can cure into one sentence and exit code 2."""

    command_class = Command

    def main(self, *arguments: Any, **named: Any) -> Any:
        for name in ("stdout", "stderr"):
            if getattr(sys, name) is None:  # closed: there is nobody to tell
                setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 -- until the end
            elif isinstance(stream := getattr(sys, name), io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # of a terminal that knows ASCII only, say
        return super().main(*arguments, **named)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except TcbenchError as error:
            click.echo(f"Error: {visible(str(error))}", err=True)
            ctx.exit(2)
        except click.UsageError as error:
            click.echo(f"Error: {visible(one_sentence(error))}", err=True)
            ctx.exit(2)
        except ValueError as error:  # of a configuration; a shell cannot say it
            if "embedded null" not in str(error):
                raise
            click.echo("Error: a name has a null byte in it, which no file can have.", err=True)
            ctx.exit(2)
        except KeyboardInterrupt:
            click.echo("Interrupted.", err=True)
            ctx.exit(130)
        except BrokenPipeError:
            sys.stderr.close()
            ctx.exit(1)
        except OSError as error:
            if error.filename is not None:
                click.echo(f"Error: {visible(str(error.filename)[:200])!r}: {error.strerror}.", err=True)
                ctx.exit(2)
            if error.errno not in UNWRITABLE:
                raise
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or the interpreter tries once more when it ends
            click.echo(f"Error: the output cannot be written: {error.strerror}.", err=True)
            ctx.exit(2)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            raise unknown_name("command", args[0], self.commands, "See tcbench --help.")
        return super().resolve_command(ctx, args)
