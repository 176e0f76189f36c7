"""Source tree: definitions of the three layers and what each of them refers to, read from the syntax alone."""

from __future__ import annotations

import ast
import functools
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

LAYERS = ("fleet", "maps", "planners")

Function = ast.FunctionDef | ast.AsyncFunctionDef
Definition = Function | ast.ClassDef

_DOTTED = re.compile(r"(?:fleet|maps|planners)(?:\.\w+)+(?::\w+)?")
"""Text that names a module, or an object in one as entry points do."""
_BESIDE = re.compile(r"\w+(?:\.\w+)+")
"""Text that may name an object in a module of the same folder, or below it, as tables of commands do."""
_CODE_BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
_COMMAND = re.compile(r"-m (fleet(?:\.\w+)*)")


@dataclass(kw_only=True)
class Module:
    """One file."""

    name: str
    path: Path
    tree: ast.Module
    is_package: bool
    definitions: dict[str, list[ast.stmt]] = field(default_factory=dict)
    """Statements that define a name, by the name."""
    body: list[ast.stmt] = field(default_factory=list)
    """Statements that are run on import and define nothing."""
    imported: dict[str, str] = field(default_factory=dict)
    """What an imported name stands for, as a dotted path."""

    def __post_init__(self) -> None:
        for statement in _flat(self.tree.body):
            names = list(_names_of(statement))
            for name in names:
                self.definitions.setdefault(name, []).append(statement)
            if not names:
                self.body.append(statement)
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    self.imported[alias.asname or alias.name.partition(".")[0]] = (
                        alias.name if alias.asname else alias.name.partition(".")[0]
                    )
            elif isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    self.imported[alias.asname or alias.name] = f"{node.module}.{alias.name}"


class SourceTree:
    """All modules of a clone.

    Args:
        root: The clone.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.modules: dict[str, Module] = {}
        for layer in LAYERS:
            for path in sorted((root / layer).rglob("*.py")):
                words = path.relative_to(root).with_suffix("").parts
                is_package = words[-1] == "__init__"
                name = ".".join(words[:-1] if is_package else words)
                tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
                self.modules[name] = Module(name=name, path=path, tree=tree, is_package=is_package)

    def classes(self) -> Iterator[tuple[Module, ast.ClassDef]]:
        """All classes at the top of a module."""
        for module in self.modules.values():
            for statements in module.definitions.values():
                yield from ((module, statement) for statement in statements if isinstance(statement, ast.ClassDef))

    def resolve(self, dotted: str) -> tuple[str, str]:
        """The module and the name in it that a dotted path stands for, through re-exports.

        Returns:
            Module and name; an empty name for a module itself, two empty ones for what is not in the tree.
        """
        seen = set()
        while dotted not in seen:
            seen.add(dotted)
            if dotted in self.modules:
                return dotted, ""
            home = self.home(dotted)
            if not home:
                return "", ""
            module, (name, *rest) = self.modules[home], dotted[len(home) + 1 :].split(".")
            if name in module.definitions:
                return module.name, name
            if name not in module.imported:
                return module.name, ""
            dotted = ".".join([module.imported[name], *rest])
        return "", ""

    def home(self, dotted: str) -> str:
        """The longest beginning of a dotted path that is a module; empty if none is."""
        words = re.split(r"[.:]", dotted)
        heads = (".".join(words[:k]) for k in range(len(words), 0, -1))
        return next((head for head in heads if head in self.modules), "")

    def target(self, module: Module, dotted: str) -> tuple[str, str]:
        """The module and the name in it that a name, or a dotted path, stands for inside a module."""
        first, _, rest = dotted.partition(".")
        if first in module.definitions:
            return module.name, first
        if first in module.imported:
            return self.resolve(f"{module.imported[first]}.{rest}" if rest else module.imported[first])
        return "", ""


@functools.cache
def source_tree(root: Path) -> SourceTree:
    """The tree of a clone, read once."""
    return SourceTree(root)


def unreached(tree: SourceTree, entries: list[str], texts: list[tuple[str, str]]) -> set[str]:
    """Modules, and names in reached modules, that no path leads to.

    What is reached reaches all that it refers to: names, attributes of modules, and texts that name a module. A class
    reaches all that its methods refer to. An import reaches what runs in the module on import, no more.

    Args:
        tree: The source.
        entries: Modules that are run, or objects (``module:name``).
        texts: Name and source of files outside of the tree that use it.
    """
    walk = _Walk(tree)
    for entry in entries:
        walk.text(entry)
    for name, source in texts:
        outside = Module(name=name, path=tree.root / name, tree=ast.parse(source), is_package=False)
        walk.references(outside, outside.tree.body)
        for statements in outside.definitions.values():
            walk.references(outside, statements)
        for dotted in outside.imported.values():
            walk.reach(*tree.resolve(dotted))
    walk.run()
    found = {name for name in tree.modules if name not in walk.modules}
    for name in walk.modules:
        definitions = tree.modules[name].definitions
        found |= {f"{name}.{one}" for one in definitions if (name, one) not in walk.names and one != "__all__"}
    return found


def users(root: Path) -> tuple[list[str], list[tuple[str, str]]]:
    """What the documents, examples and notebooks of a clone run and import.

    Returns:
        Modules that they run by ``python -m``, and their blocks of Python by name.
    """
    commands: list[str] = []
    texts: list[tuple[str, str]] = []
    for path in [root / "README.md", *sorted((root / "docs" / "guide").glob("*.md"))]:
        text = path.read_text(encoding="utf-8")
        commands += [f"{name}.__main__" if name == "fleet" else name for name in _COMMAND.findall(text)]
        texts += [(f"{path.name}:{k}", block) for k, block in enumerate(_CODE_BLOCK.findall(text))]
    for path in sorted((root / "docs" / "examples").rglob("*.py")):
        texts.append((path.name, path.read_text(encoding="utf-8")))
    for path in sorted((root / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        for k, cell in enumerate(cells):
            if cell["cell_type"] == "code":
                # Lines for the notebook's own shell are no Python.
                lines = [line for line in "".join(cell["source"]).splitlines() if not line.startswith(("%", "!"))]
                texts.append((f"{path.name}:{k}", "\n".join(lines)))
    return commands, texts


class _Walk:
    """What has been reached so far."""

    def __init__(self, tree: SourceTree) -> None:
        self._tree = tree
        self.modules: set[str] = set()
        self.names: set[tuple[str, str]] = set()
        self._waiting: list[tuple[Module, list[ast.stmt]]] = []

    def run(self) -> None:
        """Follow all references."""
        while self._waiting:
            self.references(*self._waiting.pop())

    def reach(self, module: str, name: str) -> None:
        """Reach a module and a name in it."""
        if module not in self._tree.modules:
            return
        parts = module.split(".")
        for k in range(1, len(parts) + 1):
            home = ".".join(parts[:k])
            if home in self._tree.modules and home not in self.modules:
                self.modules.add(home)
                self._waiting.append((self._tree.modules[home], self._tree.modules[home].body))
        if name and (module, name) not in self.names:
            self.names.add((module, name))
            self._waiting.append((self._tree.modules[module], self._tree.modules[module].definitions[name]))

    def text(self, text: str) -> None:
        """Reach what a text names, if it does."""
        if _DOTTED.fullmatch(text):
            self.reach(self._tree.home(text), "")
            self.reach(*self._tree.resolve(text.replace(":", ".")))

    def _beside(self, module: Module, text: str) -> None:
        """Reach an object in a module of the same folder, if a text names one."""
        folder = module.name if module.is_package else module.name.rpartition(".")[0]
        path = f"{folder}.{text}"
        home, name = self._tree.resolve(path)
        if name and self._tree.home(path) != folder:
            self.reach(home, name)

    def references(self, module: Module, statements: list[ast.stmt]) -> None:
        """Reach all that statements of a module refer to."""
        for statement in statements:
            if isinstance(statement, ast.Import | ast.ImportFrom):
                self._import(statement)
                continue
            for dotted in _references(statement, frozenset()):
                self.reach(*self._tree.target(module, dotted))
            for node in ast.walk(statement):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    self.text(node.value)
                    if _BESIDE.fullmatch(node.value):
                        self._beside(module, node.value)
                elif isinstance(node, ast.Import | ast.ImportFrom):
                    self._import(node)

    def _import(self, node: ast.Import | ast.ImportFrom) -> None:
        """Run what is imported, without reaching a name in it: names count where they are used."""
        paths = [alias.name for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            paths = [node.module or "", *(f"{node.module}.{path}" for path in paths)]
        for path in paths:
            module, _ = self._tree.resolve(path)
            self.reach(module, "")


def _references(node: ast.AST, bound: frozenset[str]) -> Iterator[str]:
    """Names and dotted paths that a node loads, without what its functions bind themselves."""
    if isinstance(node, ast.Name):
        if isinstance(node.ctx, ast.Load) and node.id not in bound:
            yield node.id
        return
    if isinstance(node, ast.Attribute) and (dotted := dotted_name(node)):
        if dotted.partition(".")[0] not in bound:
            yield dotted
        return
    if isinstance(node, Function):
        for outside in (*node.decorator_list, node.args, *filter(None, [node.returns])):
            yield from _references(outside, bound)
        inside = bound | _bound_in(node)
        for statement in node.body:
            yield from _references(statement, inside)
        return
    for child in ast.iter_child_nodes(node):
        yield from _references(child, bound)


def _bound_in(function: Function) -> set[str]:
    arguments = function.args
    names = {one.arg for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)}
    names |= {one.arg for one in (arguments.vararg, arguments.kwarg) if one}
    shared: set[str] = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Global):
            shared |= set(node.names)
    return names - shared


def dotted_name(node: ast.AST) -> str:
    """``a.b.c`` of an attribute of names; empty for an attribute of anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (head := dotted_name(node.value)):
        return f"{head}.{node.attr}"
    return ""


def _flat(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements at the top, with those inside of conditions that stand there, but for the one of a script."""
    for statement in body:
        if isinstance(statement, ast.If) and "__name__" not in ast.unparse(statement.test):
            yield ast.Expr(statement.test)
            yield from _flat([*statement.body, *statement.orelse])
        elif isinstance(statement, ast.Try):
            handled = [line for handler in statement.handlers for line in handler.body]
            yield from _flat([*statement.body, *handled, *statement.orelse, *statement.finalbody])
        else:
            yield statement


def _names_of(statement: ast.stmt) -> Iterator[str]:
    """Names that a statement defines."""
    if isinstance(statement, Definition):
        yield statement.name
        return
    targets: list[ast.expr] = []
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    elif isinstance(statement, ast.AnnAssign | ast.AugAssign):
        targets = [statement.target]
    for target in targets:
        yield from (node.id for node in ast.walk(target) if isinstance(node, ast.Name))
