"""No circles within a layer, and plugins use the public door only: what import-linter does not see."""

import ast
import functools
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).parent.parent
PLUGINS = sorted((ROOT / "plugins").rglob("*.py"))


def test_no_module_imports_one_that_imports_it():
    graph = grimp.build_graph("tcbench", "tcbench_plugins", exclude_type_checking_imports=True, cache_dir=None)
    TopologicalSorter({m: graph.find_modules_directly_imported_by(m) for m in graph.modules}).prepare()


@functools.cache
def tree(path):
    return ast.parse(path.read_text("utf-8"))


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
