"""What holds for every layout that `prepare` reads, on the made trees of the goldens."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import pytest

from tests.goldens.run import CASES, run, unpack

PREPARED = [
    (tree, line)
    for tree, lines in CASES.items()
    for line in lines
    if line.startswith("prepare ") and "airzoo-mini" not in line and "|" not in line
]
FILES_A_TREE = 2


@pytest.mark.parametrize(("tree", "command"), PREPARED, ids=[line for _, line in PREPARED])
def test_a_second_run_has_nothing_to_do(tree: str, command: str, tmp_path: Path) -> None:
    unpack(tree, tmp_path)
    assert run(command, tmp_path)[0] == 0
    code, said = run(command, tmp_path)
    assert code == 0
    assert "nothing to do" in said


def remove(path: Path) -> None:
    path.unlink()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def scribble(path: Path) -> None:
    path.write_bytes(b"<html>not found</html>\n")


@pytest.mark.parametrize(("tree", "command"), PREPARED, ids=[line for _, line in PREPARED])
def test_a_spoiled_file_is_no_bug_of_the_suite(tree: str, command: str, tmp_path: Path) -> None:
    """It is named, or it is not read."""
    whole = tmp_path / "whole"
    unpack(tree, whole)
    source = whole / "in" if (whole / "in").is_dir() else whole
    files = [path.relative_to(whole) for path in sorted(source.rglob("*")) if path.is_file()]
    order = random.Random(command)
    for number, file in enumerate(order.sample(files, min(FILES_A_TREE, len(files)))):
        home = tmp_path / f"spoiled{number}"
        shutil.copytree(whole, home)
        spoil = order.choice((remove, cut, empty, scribble))
        spoil(home / file)
        code, said = run(command, home)
        assert code in (0, 1, 2), f"{spoil.__name__} {file}: exit {code}\n{said}"
        assert "bug of the suite" not in said
        assert "fix:" in said or "expected:" in said or code == 0, f"{file}: {said}"
        shutil.rmtree(home)
