# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Static call graph: which functions of the test modules are called by tests."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

TESTS = Path(__file__).parent.parent


class Name(NamedTuple):
    """A top-level name of a module; the module itself if `name` is empty."""

    module: str
    name: str


class CallGraph:
    """The top-level definitions of the modules in `tests/`, and the definitions that each of them uses.

    A use counts as a call. Modules are resolved through imports of names and of modules.
    """

    def __init__(self, folder: Path = TESTS) -> None:
        """Parse every module of a folder."""
        self._definitions: dict[Name, list[ast.stmt]] = {}
        self._imports: dict[Name, Name] = {}
        trees = {".".join(path.relative_to(folder).with_suffix("").parts): path for path in folder.rglob("*.py")}
        self._modules = set(trees)
        for module, path in trees.items():
            self._add(module, ast.parse(path.read_text(encoding="utf-8")))

    def called_by_tests(self) -> set[Name]:
        """Return every definition that a test reaches."""
        seen: set[Name] = set()
        waiting = [name for name in self._definitions if name.module.startswith("test_") and name.name[:5] == "test_"]
        while waiting:
            name = waiting.pop()
            if name not in seen:
                seen.add(name)
                for statement in self._definitions[name]:
                    waiting += self._uses(name.module, statement)
        return seen

    def _add(self, module: str, tree: ast.Module) -> None:
        for statement in tree.body:
            for name in _defined(statement):
                self._definitions.setdefault(Name(module, name), []).append(statement)
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    whole = f"{node.module}.{alias.name}"
                    if whole in self._modules:
                        self._imports[Name(module, alias.asname or alias.name)] = Name(whole, "")
                    elif node.module in self._modules:
                        self._imports[Name(module, alias.asname or alias.name)] = Name(node.module, alias.name)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    if alias.name in self._modules:
                        self._imports[Name(module, alias.asname or alias.name)] = Name(alias.name, "")

    def _resolve(self, name: Name) -> Name | None:
        """Follow imports to a definition or a module."""
        while name not in self._definitions:
            if name not in self._imports:
                return None
            name = self._imports[name]
            if not name.name:
                return name
        return name

    def _uses(self, module: str, statement: ast.stmt) -> Iterator[Name]:
        for node in ast.walk(statement):
            found = None
            if isinstance(node, ast.Name):
                found = self._resolve(Name(module, node.id))
            elif isinstance(node, ast.arg):  # a fixture
                found = self._resolve(Name(module, node.arg))
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                owner = self._resolve(Name(module, node.value.id))
                if owner and not owner.name:
                    found = self._resolve(Name(owner.module, node.attr))
            if found and found.name:
                yield found


def _defined(statement: ast.stmt) -> Iterator[str]:
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        yield statement.name
    elif isinstance(statement, ast.Assign | ast.AnnAssign):
        for target in statement.targets if isinstance(statement, ast.Assign) else [statement.target]:
            yield from (node.id for node in ast.walk(target) if isinstance(node, ast.Name))
