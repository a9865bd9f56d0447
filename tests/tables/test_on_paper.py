"""How LaTeX tables fit a paper: widths, where heads and numbers stand, what is printed below."""

from __future__ import annotations

from dataclasses import replace

from airzoo_bench.tables.layouts import benchmarks_layout
from airzoo_bench.tables.method_table import method_table
from tests.results.made import result


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
