"""What holds for every layout that `prepare` reads, on the made trees of the goldens."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.goldens.run import CASES, run, unpack

PREPARED = [
    (tree, line)
    for tree, lines in CASES.items()
    for line in lines
    if line.startswith("prepare ") and "airzoo-mini" not in line and "|" not in line
]


def remove(path: Path) -> None:
    path.unlink()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def scribble(path: Path) -> None:
    path.write_bytes(b"<html>not found</html>\n")


@pytest.mark.parametrize("number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
@pytest.mark.parametrize(("tree", "command"), PREPARED, ids=[line for _, line in PREPARED])
def test_a_spoiled_file_is_no_bug_of_the_suite(
    tree: str, command: str, number: int, tmp_path: Path
) -> None:
    """It is named, or it is not read."""
    whole = tmp_path / "whole"
    unpack(tree, whole)
    source = whole / "in" if (whole / "in").is_dir() else whole
    files = [path.relative_to(whole) for path in sorted(source.rglob("*")) if path.is_file()]
    order = random.Random(f"{command} {number}")
    file, spoil = order.choice(files), order.choice((remove, cut, empty, scribble))
    spoil(whole / file)
    code, said = run(command, whole)
    assert code in (0, 1, 2), f"{spoil.__name__} {file}: exit {code}\n{said}"
    assert "bug of the suite" not in said
    assert "fix:" in said or "expected:" in said or code == 0, f"{file}: {said}"
