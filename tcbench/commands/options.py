"""What the options of several commands have in common: types, defaults, completion, help."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from .. import progress
from ..errors import TcbenchError, unknown_name

CONFIG_FILE = "tcbench.config"  # key of a context's notes: the file that options are from
LATEST = Path("results/latest")  # where `run` writes and whatever reads a run looks, unless told otherwise


def completion(*places: str) -> Callable[..., list[str]]:
    """Names for the shell's completion: what functions of tcbench, "MODULE:FUNCTION", have by name."""

    def names(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
        every = (name for place in places for name in pkgutil.resolve_name(f"tcbench.{place}")())
        return [name for name in every if name.startswith(incomplete)]

    return names


def many(kind: str, help: str) -> Callable[..., Any]:
    """-i or -s: several names or patterns."""
    return one(kind, f"{help} Or a pattern ('{'tc_*' if kind == 'integrator' else '*_term'}'); repeat for several.")


def one(kind: str, help: str) -> Callable[..., Any]:
    """-i or -s of a command that takes one of them; `many` without the advice to repeat it."""
    names = completion(f"plugins:{kind}s")
    return click.option(
        f"--{kind}", f"-{kind[0]}", f"{kind}s", multiple=True, metavar="NAME", shell_complete=names, help=help
    )


def use_plugins(ctx: click.Context, parameter: click.Parameter, folders: tuple[str, ...]) -> None:
    """Make the plugin folders of the command line known."""
    if folders and not ctx.resilient_parsing:
        from .. import plugins

        plugins.use_folders(folders)


PLUGINS = click.option(
    "--plugins-dir", multiple=True, type=click.Path(), metavar="FOLDER", envvar="TCBENCH_PLUGINS_DIR",
    show_envvar=True, callback=use_plugins, expose_value=False,
    help="Also load the plugin files in FOLDER (they are Python code: name only what you trust).",
)  # fmt: skip


def be_quiet(ctx: click.Context, parameter: click.Parameter, quiet: bool) -> bool:
    """Say nothing on the way if that is wanted."""
    if quiet:
        progress.default = False
    return quiet


QUIET = click.option(
    "--quiet", "-q", is_flag=True, callback=be_quiet, help="No progress and no tables, errors only."
)  # fmt: skip


def runs(name: str = "folder", required: bool = False, shown: str = "[FOLDER]") -> Callable[..., Any]:
    """The folder of a run."""
    default: dict[str, Any] = {} if required else {"default": LATEST}  # None would be a value: nothing would be missing
    return click.argument(name, type=click.Path(path_type=Path), required=required, metavar=shown, **default)


class Folder(click.Path):
    """A folder to write into; the empty name is a mistake, such as a shell variable that is not set."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value).strip():
            raise TcbenchError("The name of the output folder is empty; the current folder is '.'.")
        return super().convert(value, param, ctx)


def output(default: Path, help: str = "Folder to write to.") -> Callable[..., Any]:
    return click.option(
        "--output", "-o", type=Folder(), default=default, show_default=True, help=help
    )  # fmt: skip


def read_config(ctx: click.Context, parameter: click.Parameter, path: Path | None) -> None:
    """Take options from a TOML file, by the names they have on the command line, which wins over the file."""
    if path is None:
        return
    import tomllib

    try:
        with open(path, "rb") as file:  # a pipe, too, as of `--config <(...)`
            config = tomllib.load(file)
    except (OSError, ValueError) as error:  # ValueError: not TOML, or not text
        raise TcbenchError(f"{str(path)!r} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    parameters = {word.lstrip("-"): p for p in ctx.command.params for word in p.opts if word.startswith("--")}
    parameters.pop("config", None)
    values = {}
    for name, value in config.items():
        if name not in parameters:
            raise unknown_name(f"option in {str(path)!r}", name, parameters)
        option = parameters[name]
        values[option.name or ""] = _as_typed(f"{name!r} in {str(path)!r}", option, value)
    ctx.meta[CONFIG_FILE] = str(path)
    ctx.default_map = {**(ctx.default_map or {}), **values}


def _as_typed(name: str, option: click.Parameter, value: Any) -> Any:
    """A value of the file as it would be typed on the command line, so that click says what is wrong with it."""
    if getattr(option, "is_flag", False):
        if not isinstance(value, bool):
            raise TcbenchError(f"{name} is true or false, not {value!r}.")
        return value
    if isinstance(value, list) and not option.multiple:
        raise TcbenchError(f"{name} is one value, not a list.")
    return [str(v) for v in (value if isinstance(value, list) else [value])] if option.multiple else str(value)


CONFIG = click.option(
    "--config", type=click.Path(path_type=Path, dir_okay=False), callback=read_config, is_eager=True,
    expose_value=False, metavar="FILE", help="Take options from this TOML file: their names here, without dashes.",
)  # fmt: skip


def one_sentence(error: click.UsageError) -> str:
    """What is wrong with an option, and the file that it is from, where that is not the command line."""
    ctx, option = error.ctx, getattr(error, "param", None)
    text = error.format_message()
    text += "" if text.endswith((".", "?")) else "."  # of too many words click makes no sentence
    if ctx is not None and "unexpected extra" in text and any(p.name == "integrators" for p in ctx.command.params):
        text += " Integrators are named with -i, scenarios with -s."
    if ctx is not None and option is not None and ctx.get_parameter_source(option.name) == ParameterSource.DEFAULT_MAP:
        text = f"{ctx.meta[CONFIG_FILE]!r}: {text}"
    return text if ctx is None or text.endswith("?") else f"{text} See tcbench {ctx.info_name} --help."


def words(
    names: tuple[str, ...], integrators: tuple[str, ...], scenarios: tuple[str, ...]
) -> tuple[Sequence[str], Sequence[str]]:
    """Integrators and scenarios of words without -i and -s: the last is the scenario, unless -s names one."""
    if names and not scenarios:
        methods, chosen = (*integrators, *names[:-1]), names[-1:]
    else:
        methods, chosen = (*integrators, *names), scenarios
    if names:
        _in_their_places(methods, chosen)
    return methods, chosen


def _in_their_places(methods: Sequence[str], chosen: Sequence[str]) -> None:
    """TcbenchError where a scenario stands in the place of an integrator, or is missing."""
    from .. import plugins

    here = plugins.registry()
    scenes = {*here.scenarios, *here.scenario_families} - set(here.integrators)

    def bare(name: str) -> str:
        return name.partition("[")[0]

    for name in methods:
        if bare(name) in scenes:
            raise TcbenchError(f"{name} is a scenario and comes last, after the integrators: swap them.")
    for name in chosen:
        if bare(name) in here.integrators and bare(name) not in scenes:
            raise TcbenchError(f"{name} is an integrator: the scenario is missing, the last word. See tcbench list.")
