"""Files of published numbers, good and bad."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.layouts import methods_layout, scenes_layout
from airzoo_bench.tables.method_table import MethodTable
from airzoo_bench.tables.published import published_tables, read_source
from airzoo_bench.tables.reported_rows import with_published

SOURCE = """
schema = 1
name = "s"
title = "S"
url = "u"
data = "s.csv"
[benchmarks]
"B" = "b"
[scores.retrieval]
"R" = "recall@1"
[citations]
"""
HEAD = "table,benchmark,track,scene,method,metric,unit,value\n"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("t,C,retrieval,overall,m,R,%,1\n", "line 2, column 'benchmark': the benchmark 'C' is not"),
        ("t,B,matching,overall,m,R,%,1\n", "line 2, column 'track': the track 'matching' is not"),
        ("t,B,retrieval,overall,m,Q,%,1\n", "line 2, column 'metric': the metric 'Q' is not"),
        ("t,B,retrieval,overall,m,R,%,x\n", "line 2, column 'value': 'x' is no printed number"),
        ("t,B,retrieval,overall,m,R,%,nan\n", "line 2, column 'value': 'nan' is no printed number"),
        ("t,B,retrieval,overall,m,R,%\n", "line 2: the line has not as many fields"),
        ("t,B,retrieval,overall,m,R,%,1,2\n", "line 2: the line has not as many fields"),
        (
            "t,B,retrieval,overall,m,R,%,1\nt,B,retrieval,Average,m,R,%,1\n",
            "line 3: m has R twice",
        ),
    ],
)
def test_a_bad_file_of_published_numbers(rows: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SOURCE, encoding="utf-8")
    (tmp_path / "s.csv").write_text(HEAD + rows, encoding="utf-8")
    with pytest.raises(ResultError, match=message):
        read_source(tmp_path / "s.toml")


def test_a_source_without_its_numbers(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SOURCE, encoding="utf-8")
    with pytest.raises(ResultError, match="no such table of published numbers"):
        read_source(tmp_path / "s.toml")
    (tmp_path / "s.csv").write_text("table,benchmark\n", encoding="utf-8")
    with pytest.raises(ResultError, match="no column 'method', 'scene', 'metric'"):
        read_source(tmp_path / "s.toml")
    (tmp_path / "s.toml").write_text(SOURCE.replace("url", "ulr"), encoding="utf-8")
    with pytest.raises(ResultError, match="unknown key 'ulr'"):
        read_source(tmp_path / "s.toml")


def test_published_tables_by_benchmark_and_track() -> None:
    labels = [t.label for t in published_tables("airzoo-real", "matching")]
    assert labels == ["tab:translation_accuracy", "tab:matching_results"]
    assert [t.has_scenes for t in published_tables("airzoo-real", "matching")] == [False, True]
    assert published_tables("airzoo-mini", "retrieval") == []


def test_published_scenes_are_found_by_their_titles() -> None:
    score = ScoreColumn(
        key="recall@1",
        title="R@1",
        unit="share",
        higher_is_better=True,
        average="mean",
        headline=True,
    )
    scenes = {"02": "Scene 2", "01": "Scene 1", "x": "Scene X"}
    board = MethodTable("T", "uav-visloc", "retrieval", (score,), scenes, {}, ())
    tables = published_tables("uav-visloc", "retrieval")
    made = scenes_layout(with_published(board, tables, by_scene=True))
    assert made.texts()[1] == ["SALAD †", "22.97", "28.27", "–", "19.50"]
    assert methods_layout(with_published(board, tables, by_scene=False)).texts()[1][1] == "25.72"
