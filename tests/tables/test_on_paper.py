"""How LaTeX tables fit a paper: widths, where heads and numbers stand, what is printed below."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from airzoo_bench.tables.blocks import by_count
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.latex_text import latex_width
from airzoo_bench.tables.layouts import benchmarks_layout
from airzoo_bench.tables.method_table import method_table
from tests.results.made import result
from tests.support import HANGS_S
from tests.tables.small_tables import scored
from tests.tables.typeset import document


@pytest.mark.parametrize(("kind", "blocks"), [("alone", 1), ("gains", 2), ("intervals", 2)])
def test_what_stands_beside_numbers_takes_room(
    kind: str, blocks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("airzoo_bench.tables.blocks.PAGE", 70)
    table = replace(scored(kind, 3), groups_per_block=3)
    assert len(by_count(table)) == blocks
    assert len(by_count(replace(table, fixed=True))) == 1
    # Two abreast are the paper's, and made to fit by it.
    assert len(by_count(scored(kind, 2))) == 1


@pytest.mark.parametrize("kind", ["alone", "gains", "intervals"])
def test_the_estimate_is_near_the_width(kind: str, tmp_path: Path) -> None:
    if shutil.which("pdflatex") is None:
        pytest.skip("pdflatex is not installed")
    table = scored(kind)
    boxed = [r"\newsavebox{\tablebox}\begin{lrbox}{\tablebox}", latex(table), r"\end{lrbox}"]
    shown = document("\n".join([*boxed, r"\typeout{WIDTH \the\wd\tablebox}\usebox{\tablebox}"]))
    (tmp_path / "table.tex").write_text(shown, encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "table.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=HANGS_S)
    found = re.search(rb"WIDTH ([\d.]+)pt", done.stdout)
    assert found, done.stdout[-1000:]
    (piece, *_) = by_count(table)
    assert 10 * latex_width(piece) == pytest.approx(float(found[1]), rel=0.06)


def test_benchmarks_go_by_their_titles() -> None:
    board = method_table([result("m")])
    tracks = [("airzoo-mini", "matching"), ("airzoo-mini", "retrieval"), ("lake", "retrieval")]
    boards = [
        replace(board, benchmark=name, track=track, title=f"{name}-{track} v1")
        for name, track in tracks
    ]

    def heads(*numbers: int) -> list[str]:
        made = benchmarks_layout([boards[i] for i in numbers])
        return list(dict.fromkeys(column.group for column in made.columns if column.group))

    assert heads(1, 2) == ["AirZoo-Mini", "lake"]
    assert heads(0, 1, 2) == ["AirZoo-Mini, matching", "AirZoo-Mini, retrieval", "lake"]
    variants = [boards[0], replace(boards[0], title="other v1")]
    found = {column.group for column in benchmarks_layout(variants).columns}
    assert found == {"", "airzoo-mini-matching v1", "other v1"}


def test_of_which_benchmark_there_is_no_interval_is_said_below() -> None:
    board = method_table([result("m")])
    notes = ("in square brackets: all", "no interval for the average: few")
    first = replace(board.noted(*notes), benchmark="a", about_intervals=notes)
    second = replace(board.noted(notes[0]), benchmark="b", about_intervals=notes[:1])
    made = benchmarks_layout([first, second])
    assert made.legend == (notes[0], f"a: {notes[1]}")
    assert set(made.legend) <= set(made.notes)
