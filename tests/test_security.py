"""SECURITY.md names the tests that hold each promise; they must be there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
NAMED = re.findall(r"`(tests/[^`]+)`", TEXT)


def defined(tree: ast.AST) -> dict[str, ast.AST]:
    kinds = (ast.FunctionDef, ast.ClassDef)
    return {node.name: node for node in ast.iter_child_nodes(tree) if isinstance(node, kinds)}


@pytest.mark.parametrize("name", sorted(set(NAMED)))
def test_each_named_test_is_there(name: str) -> None:
    file, *parts = name.split("::")
    place: ast.AST = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    if not parts:
        assert any(found.startswith("test_") or found[:4] == "Test" for found in defined(place))
    for part in parts:
        assert part in defined(place), f"{file} has no {part}"
        place = defined(place)[part]
    assert not parts or parts[-1].startswith(("test_", "Test"))


def test_each_promise_names_a_test() -> None:
    rows = [line for line in TEXT.splitlines() if line.startswith("| ")]
    promises = [row for row in rows if not row.startswith(("| promise", "| ---"))]
    assert len(promises) > 15
    assert all("`tests/" in row for row in promises)
