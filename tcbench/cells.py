"""What a run consists of: cells, their keys, and fingerprints of the sources that they depend on.

A cell is the unit of work, of failure and of reuse. Two cells with the same key give the same row, so a
finished key never runs again; everything that can change a row is therefore part of the key.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tcbench.errors import TcbenchError

INSTALLED = ("site-packages", "dist-packages")
JSON = None | bool | int | float | str | list[Any] | dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """One measurement to make: a study, an integrator, a scenario and the study's options.

    Attributes
    ----------
    options : the study's parameters (dt, rtol, ...); JSON values. NumPy scalars and tuples are made plain.
    timed : the row holds a timing: the cell runs alone on the machine, after all the others.
    fingerprint : hash of everything else that the row depends on (sources, scenario data, versions).
    machine : the kind of machine that a timing belongs to; empty for cells whose row is the same everywhere.

    Raises `TcbenchError` when an option is not JSON (a function, an array, a NaN-keyed dict, ...).
    """

    study: str
    integrator: str
    scenario: str
    options: Mapping[str, Any] = field(default_factory=dict)
    timed: bool = False
    fingerprint: str = ""
    machine: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", _plain_options(self.options, self))

    @cached_property
    def key(self) -> str:
        """Sha256, hexadecimal, of the canonical JSON of all fields."""
        return hashlib.sha256(canonical_json(self.as_dict()).encode()).hexdigest()

    @property
    def identity(self) -> str:
        """What the cell is, whatever code and machine measure it, as canonical JSON."""
        return identity_of(self.as_dict())

    def as_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values."""
        return {
            "study": self.study,
            "integrator": self.integrator,
            "scenario": self.scenario,
            "options": dict(self.options),
            "timed": self.timed,
            "fingerprint": self.fingerprint,
            "machine": self.machine,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Cell:
        """The inverse of `as_dict`."""
        return cls(**data)

    def __hash__(self) -> int:
        return hash(self.key)


def identity_of(cell: Mapping[str, Any]) -> str:
    """The canonical JSON of what a cell is, without the code (fingerprint) and machine that measured it."""
    return canonical_json({k: v for k, v in cell.items() if k not in ("fingerprint", "machine")})


def canonical_json(value: Any) -> str:
    """JSON text, equal for equal values: sorted keys, no spaces. Allows NaN (for hashing only)."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=plain)


def plain(value: Any) -> Any:
    """A NumPy scalar or array as a number or list (a `json` default); else raises `TypeError`."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")


def fingerprint(**parts: Any) -> str:
    """One hash of several JSON values, e.g. `fingerprint(source=..., parameters=..., versions=...)`."""
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()


def fingerprint_sources(*sources: str | Path) -> str:
    """The hash of Python files and of the local modules that they import, directly or through each other.

    Parameters
    ----------
    sources : paths of files, paths of folders (all their `.py` files), or dotted names of modules.

    Local means: in the same folder, or in the same package, as the importing file. Modules are found by
    reading (`ast`), never by importing. Paths enter relative to the folder, and line ends are normalised, so
    the hash survives a move to another machine. A file with a syntax error counts with its bytes only.

    Raises `TcbenchError` when a source does not exist.
    """
    found: dict[str, str] = {}
    for source in sources:
        for path in _resolve(source):
            _collect(path.resolve(), found, set())
    return hashlib.sha256(canonical_json(sorted(found.items())).encode()).hexdigest()


def _plain_options(options: Mapping[str, Any], cell: Cell) -> dict[str, Any]:
    try:
        return json.loads(json.dumps(dict(options), default=plain, sort_keys=True))
    except (TypeError, ValueError) as error:
        raise TcbenchError(
            f"The options of a cell of study {cell.study!r} ({cell.integrator}, {cell.scenario}) are not "
            f"JSON: {error}. "
            "Use numbers, strings, lists and dicts with string keys."
        ) from error


def _resolve(source: str | Path) -> list[Path]:
    """The files that a path or a dotted module name stands for."""
    path = Path(source)
    if path.is_dir():
        return sorted(path.rglob("*.py"))
    if path.is_file():
        return [path]
    if isinstance(source, str) and all(part.isidentifier() for part in source.split(".")):
        # find_spec of a dotted name would import its parents; walking down from the top package does not
        top, *rest = source.split(".")
        try:
            spec = find_spec(top)
        except ValueError:  # modules made by hand have no spec
            spec = None
        if spec is not None and spec.origin and spec.origin.endswith(".py"):
            folders = spec.submodule_search_locations or []
            below = [list(_module_files(Path(folder), rest)) for folder in folders] if rest else []
            files = [Path(spec.origin)] if not rest else next((f for f in below if f and _named(f[-1], rest[-1])), [])
            if files:
                return [files[-1]]
    raise TcbenchError(f"Cannot take the fingerprint of {str(source)!r}: there is no such file, folder or module.")


def _named(file: Path, name: str) -> bool:
    """Is it the file of the module or package of this name?"""
    return (file.parent.name if file.name == "__init__.py" else file.stem) == name


def _collect(path: Path, found: dict[str, str], seen: set[Path]) -> None:
    """Add to `found`, by relative name, the hashes of `path` and of the local modules it imports."""
    stack = [path]
    base = _import_folder(path)
    while stack:
        current = stack.pop()
        if current in seen:
            continue
        seen.add(current)
        text = current.read_bytes().replace(b"\r\n", b"\n")
        name = current.relative_to(base).as_posix() if current.is_relative_to(base) else current.name
        digest = hashlib.sha256(text).hexdigest()
        if found.get(name, digest) != digest:  # two plugins in two folders may each have a helper.py
            name = f"{name}#{digest}"
        found[name] = digest
        stack += [file.resolve() for file in _local_imports(current, text)]


def _import_folder(path: Path) -> Path:
    """Where absolute imports of local modules start: above the outermost package of the file."""
    folder = path.parent
    while (folder / "__init__.py").is_file():
        folder = folder.parent
    return folder


@cache
def _local_imports(path: Path, text: bytes) -> tuple[Path, ...]:
    """The files behind the import statements of one file, where they are local."""
    return tuple(_find_imports(path, text))


def _find_imports(path: Path, text: bytes) -> Iterator[Path]:
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return
    base = _import_folder(path)
    for node in _run_nodes(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _own_files(path, base, alias.name.split("."))
        elif isinstance(node, ast.ImportFrom):
            relative = 0 < node.level <= len(path.parents)
            folder = path.parents[node.level - 1] if relative else base
            find = partial(_module_files, folder) if relative else partial(_own_files, path, base)
            parts = node.module.split(".") if node.module else []
            if parts:
                yield from find(parts)
            elif (folder / "__init__.py").is_file():
                yield folder / "__init__.py"
            for alias in node.names:
                yield from find([*parts, alias.name])
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            first = node.args[0] if node.args else None
            if name in ("import_module", "__import__") and isinstance(first, ast.Constant):
                yield from _own_files(path, base, str(first.value).lstrip(".").split("."))


def _own_files(path: Path, base: Path, parts: list[str]) -> Iterator[Path]:
    """`_module_files` of an absolute import; among installed packages, of the file's own and of tcbench only."""
    own = path.relative_to(base).parts[0].removesuffix(".py")
    if base.name not in INSTALLED or parts[0] in (own, "tcbench"):
        yield from _module_files(base, parts)


def _run_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Every node but those under `if TYPE_CHECKING:`, which never runs."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        if isinstance(node, ast.If) and getattr(node.test, "attr", getattr(node.test, "id", "")) == "TYPE_CHECKING":
            waiting.extend(node.orelse)
        else:
            waiting.extend(ast.iter_child_nodes(node))


def _module_files(folder: Path, parts: Iterable[str]) -> Iterator[Path]:
    """The files that importing `a.b.c` from `folder` runs: packages and module, where they exist."""
    for part in parts:
        if not part.isidentifier():
            return
        module, package = folder / f"{part}.py", folder / part
        if (package / "__init__.py").is_file():
            yield package / "__init__.py"
        elif module.is_file():
            yield module
            return
        elif not package.is_dir():
            return
        folder = package
