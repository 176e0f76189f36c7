"""Kernels without an entry from Python are called by other kernels only: Python would crash the process with them."""

from __future__ import annotations

import ast
from pathlib import Path

INNER = frozenset({"inner", "inner_borrowing"})
COMPILED = INNER | {"kernel", "inlined", "borrowing", "njit"}


def decorators(node: ast.FunctionDef) -> set[str]:
    """Names of what a function is decorated with."""
    calls = [one.func if isinstance(one, ast.Call) else one for one in node.decorator_list]
    return {one.id for one in calls if isinstance(one, ast.Name)}


def named_by_python(tree: ast.Module) -> dict[str, set[str]]:
    """Names in functions that are not compiled, by function; `module` is code outside of functions."""
    found: dict[str, set[str]] = {}
    for node in tree.body:
        compiled = isinstance(node, ast.FunctionDef) and decorators(node) & COMPILED
        if not compiled and not isinstance(node, ast.ImportFrom):
            named = {getattr(one, "id", "") or getattr(one, "attr", "") for one in ast.walk(node)}
            found.setdefault(getattr(node, "name", "module"), set()).update(named)
    return found


def imports(tree: ast.Module) -> set[tuple[str, str]]:
    """Modules and what is imported from them."""
    froms = (node for node in tree.body if isinstance(node, ast.ImportFrom))
    return {(node.module or "", alias.name) for node in froms for alias in node.names}


def test_python_calls_no_inner_kernel(repository: Path) -> None:
    inner, trees = set[tuple[str, str]](), {}
    for folder in ("planners/motion", "tests/unit/planners/motion", "benchmarks/arms"):
        for path in sorted((repository / folder).rglob("*.py")):
            module = ".".join(path.relative_to(repository).with_suffix("").parts)
            trees[module] = tree = ast.parse(path.read_text(encoding="utf-8"))
            functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
            inner |= {(module, node.name) for node in functions if decorators(node) & INNER}
    assert len(inner) > 10
    wrong = []
    for module, tree in trees.items():
        known = {name for home, name in inner if home == module or (home, name) in imports(tree)}
        wrong += [f"{module}.{user}: {known & named}" for user, named in named_by_python(tree).items() if known & named]
    assert wrong == []


def test_a_call_from_python_is_found() -> None:
    tree = ast.parse("@inner\ndef f(): ...\n@kernel\ndef g(): f()\ndef h(): f()\nclass A:\n  x = f()\ny = m.f\n")
    assert {user for user, named in named_by_python(tree).items() if "f" in named} == {"h", "A", "module"}
