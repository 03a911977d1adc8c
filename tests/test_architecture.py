"""The house as docs/architecture.md describes it: packages, layers, what the walks name, and the plugins' door."""

import ast
import functools
import re
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).parent.parent
HOUSE = ROOT / "tcbench"
PAGE = (ROOT / "docs" / "architecture.md").read_text("utf-8")
REFERENCE = (ROOT / "docs" / "api.md").read_text("utf-8")
LAYERS = next(
    c for c in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    if c["type"] == "layers"
)["layers"]  # fmt: skip
PACKAGES = {path.parent.name for path in HOUSE.glob("*/__init__.py")}
MODULES = {path.stem for path in HOUSE.glob("*.py")}
PLUGINS = sorted((ROOT / "plugins").rglob("*.py"))


def test_the_page_has_the_layers_of_the_contract():
    block = PAGE.split('```text title="layers"\n')[1].split("```")[0]
    assert [re.split(r"  +", line)[0] for line in block.splitlines()] == LAYERS


def test_the_page_names_every_package_and_no_other():
    table = PAGE.split("## The packages")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == PACKAGES


def test_no_module_imports_one_that_imports_it():
    graph = grimp.build_graph("tcbench", "tcbench_plugins", exclude_type_checking_imports=True, cache_dir=None)
    TopologicalSorter({m: graph.find_modules_directly_imported_by(m) for m in graph.modules}).prepare()


@functools.cache
def tree(path):
    return ast.parse(path.read_text("utf-8"))


def defined(path):
    """Whether `tcbench.` + path is a module, or a name that one defines (also in a class)."""
    parts = path.split(".")
    for i in range(len(parts), 0, -1):
        file = HOUSE.joinpath(*parts[:i])
        file = file.with_suffix(".py") if file.with_suffix(".py").is_file() else file / "__init__.py"
        if file.is_file():
            body, rest = tree(file).body, parts[i:]
            for name in rest:
                found = [n for n in body if name in names_of(n)]
                if not found:
                    return False
                body = getattr(found[0], "body", [])
            return True
    return False


def names_of(node):
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {t.id for t in targets if isinstance(t, ast.Name)}


def test_what_the_walks_name_is_there():
    named = {n for n in re.findall(r"`([a-z_]+(?:\.\w+)+)`", PAGE) if n.split(".")[0] in PACKAGES | MODULES}
    assert len(named) > 40
    assert not [name for name in sorted(named) if not defined(name)]
    assert not defined("engine.planning.no_such_name") and not defined("no_such_package.run")


def imports_of_tcbench():
    """(module below tcbench, name) of every import in the plugins, and the private attributes that they use."""
    for path in PLUGINS:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "tcbench" and not node.level:
                for alias in node.names:
                    yield path.name, node.module, alias.name
            elif isinstance(node, ast.Import):
                assert not any(a.name.startswith("tcbench.") for a in node.names), f"{path.name}: from ... import ..."


def test_plugins_use_public_names_that_the_reference_lists():
    import tcbench

    door = REFERENCE.split("## For methods with a solver of their own")[1].split("\n## ")[0]
    listed = dict(re.findall(r"^\| `(tcbench(?:\.\w+)+)` \| (.*?) \|", door, re.MULTILINE))
    rendered = set(re.findall(r"^::: (\S+)$", REFERENCE, re.MULTILINE))
    used = {}
    for file, module, name in imports_of_tcbench():
        assert not name.startswith("_"), f"{file} imports {module}.{name}"
        if module == "tcbench":
            assert name in tcbench.__all__, f"{file} imports tcbench.{name}"
        elif f"{module}.{name}" not in rendered:
            if name in {p.stem for p in (ROOT / module.replace(".", "/")).glob("*.py")}:  # a module, by its name
                module, name = f"{module}.{name}", ""
            used.setdefault(module, set()).add(name)
    for module, names in used.items():
        assert module in listed, f"{module} is used by plugins and is not in the door of docs/api.md"
        missing = {n for n in names if n and f"`{n}`" not in listed[module]}
        assert not missing, f"{module}: {missing}"
    assert set(listed) == set(used), "the door has what no plugin uses"


def test_plugins_use_no_private_attribute_of_tcbenchs_objects():
    assert len(PLUGINS) > 20
    for path in PLUGINS:
        nodes = [*ast.walk(tree(path))]
        own = {n.attr for n in nodes if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store)}
        own |= {n.name for n in nodes if isinstance(n, ast.FunctionDef)}
        for node in nodes:
            if isinstance(node, ast.Attribute) and node.attr.startswith("_") and node.attr not in own:
                public = node.attr in ("_replace", "_asdict", "_fields")  # of NamedTuples
                assert public or (node.attr[:2] == "__" and node.attr != "__wrapped__"), f"{path}: {node.attr}"
