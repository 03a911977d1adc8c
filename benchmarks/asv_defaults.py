"""Loaded by asv (asv.conf.json, "plugins"): `asv run` asks nothing, and without --bench runs every_commit.py only."""

from typing import Any

DEFAULT = r"^every_commit\."


def setup() -> None:
    """What asv calls when it loads its plugins."""
    from asv.benchmarks import Benchmarks

    describe_machine()
    discover = Benchmarks.discover.__func__  # type: ignore[attr-defined]

    def chosen(cls: type, conf: Any, repo: Any, environments: Any, commits: Any, regex: Any = None, **more: Any) -> Any:
        return discover(cls, conf, repo, environments, commits, regex=regex or DEFAULT, **more)

    Benchmarks.discover = classmethod(chosen)  # type: ignore[method-assign]


def describe_machine() -> None:
    """What `asv machine --yes` does, where it has not been done."""
    from asv.machine import Machine, MachineCollection
    from asv.util import UserError

    name = Machine.get_unique_machine_name()
    try:
        MachineCollection.load(name)
    except UserError:
        MachineCollection.save(name, {**Machine.get_defaults(), "machine": name})
