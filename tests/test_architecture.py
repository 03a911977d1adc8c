"""No circles within a layer, and plugins use the public door only: what import-linter does not see."""

import ast
import functools
import re
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).parent.parent
REFERENCE = (ROOT / "docs" / "api.md").read_text("utf-8")
PLUGINS = sorted((ROOT / "plugins").rglob("*.py"))


def test_no_module_imports_one_that_imports_it():
    graph = grimp.build_graph("tcbench", "tcbench_plugins", exclude_type_checking_imports=True, cache_dir=None)
    TopologicalSorter({m: graph.find_modules_directly_imported_by(m) for m in graph.modules}).prepare()


@functools.cache
def tree(path):
    return ast.parse(path.read_text("utf-8"))


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
