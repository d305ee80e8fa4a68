"""The code runs on Python 3.8, also where only a newer one is there to try it."""

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "g1_description"
FILES = sorted(SOURCE.rglob("*.py"))
BUILT_IN = {"dict", "frozenset", "list", "set", "tuple", "type"}
FROM = {"collections", "collections.abc", "concurrent.futures", "os", "queue"}
"""Modules whose classes take type arguments from Python 3.9 on."""


def annotations(node):
    """List what is an annotation of a node: with the future import, nobody runs it."""
    if isinstance(node, ast.AnnAssign):
        return [node.annotation]
    if isinstance(node, ast.arg):
        return [node.annotation]
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        return [node.returns]
    return []


def run_nodes(node):
    """Walk through what Python runs."""
    yield node
    left_out = annotations(node)
    for child in ast.iter_child_nodes(node):
        if child not in left_out:
            yield from run_nodes(child)


def too_new(text):
    """List classes that get type arguments while the program runs."""
    tree = ast.parse(text, feature_version=(3, 8))
    names = BUILT_IN | {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module in FROM
        for alias in node.names
    }
    return [
        f"{node.value.id} in line {node.lineno}"
        for node in run_nodes(tree)
        if isinstance(node, ast.Subscript)
        and isinstance(node.value, ast.Name)
        and node.value.id in names
        and isinstance(node.ctx, ast.Load)
    ]


def is_run(text):
    """Tell whether Python runs the annotations of a text."""
    nodes = [node for node in ast.walk(ast.parse(text)) if any(annotations(node))]
    return bool(nodes) and "from __future__ import annotations" not in text


def test_no_class_gets_type_arguments_that_it_does_not_take():
    texts = {path: path.read_text(encoding="utf-8") for path in FILES}
    assert {path: too_new(text) for path, text in texts.items() if too_new(text)} == {}
    assert [path for path, text in texts.items() if is_run(text)] == []


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("from collections.abc import Sequence\nA = Sequence[int]", 1),
        ("from collections.abc import Sequence\na: Sequence[int] = ()", 0),
        ("from typing import Sequence\nA = Sequence[int]", 0),
        ("A = dict[str, int]", 1),
        ("def f(a: dict[str, int]) -> list[int]:\n    return a[0]", 0),
        ("from os import PathLike\nclass A(PathLike[str]): pass", 1),
    ],
)
def test_one_that_does_not_is_found(text, count):
    assert len(too_new(text)) == count
