"""Recipes: their lines are Python, and name commands and readers that are there."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from airzoo_bench.core.registry import READERS

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [DOCS / "methods.md", *sorted((DOCS / "recipes").glob("*.md"))]
EACH_PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def blocks(page: Path, kinds: tuple[str, ...]) -> list[str]:
    """Return the code blocks of a page that are of some languages."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    return [text for kind, text in found if kind in kinds]


@EACH_PAGE
def test_python_can_be_parsed(page: Path) -> None:
    for text in blocks(page, ("python",)):
        ast.parse(text)


@EACH_PAGE
def test_readers_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"--reader ([a-z][\w-]+)|reader `([\w-]+)`", text)
    assert {"".join(one) for one in named} <= {*READERS.names()}


def options_of(words: list[str]) -> set[str]:
    """Return the options of a command; none where there is no such command."""
    from airzoo_bench.cli.main import app

    command: Any = typer.main.get_command(app)
    for word in words:
        if not hasattr(command, "get_command"):
            return {name for one in command.params for name in (*one.opts, *one.secondary_opts)}
        command = command.get_command(typer.Context(command), word)
        if command is None:
            break
    return set()


@EACH_PAGE
def test_commands_and_options_are_there(page: Path) -> None:
    for text in blocks(page, ("bash", "")):
        lines = (line.strip() for line in text.replace("\\\n", " ").splitlines())
        for line in lines:
            if line.startswith("airzoo-bench "):
                words = [*shlex.split(line, comments=True)[1:], ""]
                known = options_of(words)
                assert known, line
                assert {word for word in words if word.startswith("--")} <= known, line


def test_methods_lists_every_recipe_and_reader() -> None:
    text = (DOCS / "methods.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(recipes/([\w-]+)\.md#", text)) == {page.stem for page in PAGES[1:]}
    for name in READERS.names():
        one = READERS.get(name)
        row = f"| `{name}` | {', '.join(one.methods)} | {one.layout} |".replace("*", "\\*")
        assert row in text, row
