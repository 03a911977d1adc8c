"""`tcbench new`: a plugin that runs as it is, to be edited. One file, or a distribution of its own."""

from __future__ import annotations

import keyword
import re
import sys
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

from .. import plugins
from ..errors import TcbenchError, writing
from ..studies.base import studies

_NAME = re.compile(r"[a-z][a-z0-9_]*\Z")


def new_file(kind: str, name: str, folder: Path) -> Path:
    """Write folder/name.py, a complete plugin of that kind; refuses to overwrite. Returns the path."""
    check_name(kind, name)
    path = folder / f"{name}.py"
    _write({path: _fill(f"{kind}.py", name)})
    return path


def new_package(kind: str, name: str, folder: Path) -> Path:
    """Write folder/tcbench-name: pyproject with the entry point, source, README and a test. Returns its path."""
    check_name(kind, name)
    root = folder / _distribution(name)
    if root.exists():
        raise TcbenchError(f"{str(root)!r} exists already; nothing was written. Choose another name or folder.")
    source = root / "src" / _package(name)
    _write({
        root / "pyproject.toml": _fill("pyproject.toml", name),
        root / "README.md": _fill("readme.md", name),
        source / "__init__.py": f'"""{name} for tcbench; the plugin is in plugin.py."""\n',
        source / "plugin.py": _fill(f"{kind}.py", name),
        root / "tests" / f"test_{name}.py": _fill("test.py", name).replace(f'"{name}"', f'"{checked(kind, name)}"'),
    })  # fmt: skip
    return root


def check_name(kind: str, name: str) -> None:
    """Refuse names that cannot be a Python name, and names that are taken."""
    if not _NAME.match(name) or keyword.iskeyword(name):
        raise TcbenchError(
            f"{name!r} cannot be a name: use lower-case letters, digits and underscores, as in my_method2."
        )
    if name in sys.stdlib_module_names or find_spec(name):
        raise TcbenchError(f"{name!r} is the name of an installed module, which the file would hide. Choose another.")
    names: dict[str, Any] = {"integrator": plugins.integrators, "study": studies}
    taken = names.get(kind, plugins.scenarios)()
    if checked(kind, name) in taken:
        raise TcbenchError(
            f"The {kind} name {checked(kind, name)!r} is taken. Choose another; tcbench list shows them all."
        )


def checked(kind: str, name: str) -> str:
    """The registered name that `tcbench check` takes for a new plugin: a system is checked through its scenario."""
    return f"{name}_first" if kind in ("system", "elements") else name


def _distribution(name: str) -> str:
    return f"tcbench-{name.replace('_', '-')}"


def _package(name: str) -> str:
    return f"tcbench_{name}"


def _fill(template: str, name: str) -> str:
    text = files(__package__).joinpath("templates", f"{template}.txt").read_text(encoding="utf-8")
    class_name = "".join(part.capitalize() for part in name.split("_"))
    return Template(text).substitute(
        name=name, class_name=class_name, distribution=_distribution(name), package=_package(name)
    )


def _write(contents: dict[Path, str]) -> None:
    """Write all files, or none where one exists already."""
    for path in contents:
        if path.exists():
            raise TcbenchError(f"{str(path)!r} exists already; nothing was written. Choose another name or folder.")
    for path, text in contents.items():
        with writing(repr(str(path))):
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
