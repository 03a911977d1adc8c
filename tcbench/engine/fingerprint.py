"""Fingerprints of the sources that a row depends on: files and the local modules that they import, found by reading."""

from __future__ import annotations

import ast
import hashlib
import sys
import uuid
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .. import plugins
from ..compiler.code_hash import content_hash
from ..errors import TcbenchError
from ..integrator import Integrator
from ..store.cells import UNHASHABLE
from ..store.encoding import canonical_json
from ..store.provenance import machine_name, versions
from ..studies import base
from ..studies.base import Study
from ..systems.scenario import Scenario
from ..systems.system import System

MAIN = "__main__"
INSTALLED = ("site-packages", "dist-packages")


# what an Integrator says of itself, beside what it computes (the starter has sources of its own)
SAID = ("name", "claims", "source", "tags", "description", "plugin", "base", "parameters", "family", "uses", "requires",
        "starter")  # fmt: skip


def cell_fingerprint(study: Study, method: Integrator, scenario: Scenario, options: dict[str, Any]) -> tuple[str, str]:
    """Hash of everything that a row depends on beside its options, and the machine where it is a timing."""
    metrics = plugins.metrics() if study.metrics else {}
    mark = fingerprint(
        integrator=method_sources(method), scenario=scenario.as_dict(), system=system_sources(scenario.system),
        study=_study_hash(study.name), versions=_versions() | method.versions(), order=method.order,
        metrics={name: source_hash(metric.plugin) for name, metric in metrics.items()},
    )  # fmt: skip
    return mark, _machine() if study.is_timed(options) else ""


def forget() -> None:
    """Read everything again: files may have been edited since a run before in this process."""
    known: tuple[Any, ...] = (_versions, _machine, source_hash, _study_hash, _files_of)
    for function in known:
        function.cache_clear()


def method_sources(method: Integrator) -> list[str]:
    """Hashes of what a method computes: of its plugins' files; of the code itself for an object of this session.

    What has no hash gets another one each time, which begins with `UNHASHABLE`: its rows are never used again.
    """
    uses = [source_hash(plugin) for plugin in method.uses]
    if method.memory:
        uses += method_sources(plugins.starter_of(method))
    if plugins.is_registered(method):
        return [source_hash(method.plugin), *uses]
    seen = {f.name: getattr(method, f.name) for f in fields(method) if f.name not in SAID}
    return [_or_unique(content_hash(seen)), *uses]


def method_mark(sources: Sequence[str]) -> str:
    """What a row says of the sources that measured it, its `source_hash`: short, of the method's own file."""
    return UNHASHABLE if sources[0].startswith(UNHASHABLE) else sources[0][:12]


def system_sources(system: type[System]) -> list[str]:
    """Hashes of what a system computes: the files of its class and bases; the code, too, if no plugin brings it."""
    found = list(_files_of(system))  # type: ignore[arg-type]
    return found if _is_ours(system) else [*found, _or_unique(content_hash(system))]


@cache
def _files_of(system: type[System]) -> tuple[str, ...]:
    modules = dict.fromkeys(c.__module__ for c in system.__mro__ if c not in (System, object) and c.__module__ != MAIN)
    files = [getattr(sys.modules.get(name), "__file__", None) for name in modules]
    return tuple(fingerprint_sources(file) for file in files if file and Path(file).is_file())


def _is_ours(system: type[System]) -> bool:
    """Is it of tcbench or of a plugin, which workers import as this process did?"""
    module = system.__module__
    if worker_finds(system) and module.partition(".")[0] in ("tcbench", "tcbench_plugins"):
        return True
    file = getattr(sys.modules.get(module), "__file__", None)
    return worker_finds(system) and any(file and file == o.path for o in plugins.registry().origins.values())


def worker_finds(system: type[System]) -> bool:
    """Can another process import this class by its name?"""
    found: Any = sys.modules.get(system.__module__)
    if found is None or system.__module__ == MAIN:
        return False
    for part in system.__qualname__.split("."):
        found = getattr(found, part, None)
    return found is system


def _or_unique(mark: str | None) -> str:
    return mark or f"{UNHASHABLE} {uuid.uuid4().hex}"


@cache
def _versions() -> dict[str, str | None]:
    return dict(versions())


@cache
def _machine() -> str:
    return machine_name()


@cache
def source_hash(plugin: str) -> str:
    """Hash of a plugin's file and of the local modules that it imports; "" of what no plugin brought."""
    origin = plugins.registry().origins.get(plugin)
    return fingerprint_sources(origin.path) if origin and origin.path else ""


@cache
def _study_hash(name: str) -> str:
    """Hash of a study and of everything in tcbench that it imports: the solvers, the metrics, the references."""
    return fingerprint_sources(Path(base.__file__).with_name(f"{name}.py"))


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


def local_files(path: Path, seen: set[Path]) -> Iterator[tuple[str, bytes]]:
    """Relative name and content of a file and of the local modules that it imports, but for those in `seen`."""
    stack = [path]
    base = _import_folder(path)
    while stack:
        current = stack.pop()
        if current in seen:
            continue
        seen.add(current)
        text = current.read_bytes().replace(b"\r\n", b"\n")
        yield current.relative_to(base).as_posix() if current.is_relative_to(base) else current.name, text
        stack += _local_imports(current, text)


def _collect(path: Path, found: dict[str, str], seen: set[Path]) -> None:
    """Add to `found`, by relative name, the hashes of `path` and of the local modules it imports."""
    for name, text in local_files(path, seen):
        digest = hashlib.sha256(text).hexdigest()
        if found.get(name, digest) != digest:  # two plugins in two folders may each have a helper.py
            name = f"{name}#{digest}"
        found[name] = digest


def _import_folder(path: Path) -> Path:
    """Where absolute imports of local modules start: above the outermost package of the file."""
    folder = path.parent
    while (folder / "__init__.py").is_file():
        folder = folder.parent
    return folder


@cache
def _local_imports(path: Path, text: bytes) -> tuple[Path, ...]:
    """The files behind the import statements of one file, where they are local."""
    return tuple(file.resolve() for file in dict.fromkeys(_find_imports(path, text)))


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
