"""Public: which names the reference shows."""

from __future__ import annotations

import ast
from typing import Any

import griffe


class PublicNames(griffe.Extension):
    """Shows what a package imports as itself, and no special methods without words of their own."""

    def on_alias_instance(self, *, node: ast.AST | griffe.ObjectNode, alias: griffe.Alias, **_: Any) -> None:
        """Make `x` public where a package says ``from there import x as x``."""
        names = node.names if isinstance(node, ast.ImportFrom) else []
        if any(name.name == name.asname == alias.name for name in names):
            alias.public = True

    def on_function_instance(self, *, func: griffe.Function, **_: Any) -> None:
        """Leave out `__enter__` and its like."""
        if func.name.startswith("__") and func.name != "__init__" and not func.has_docstring:
            func.public = False
