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


def test_a_source_without_its_numbers(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SOURCE, encoding="utf-8")
    with pytest.raises(ResultError, match=r"s\.csv"):
        read_source(tmp_path / "s.toml")
    (tmp_path / "s.csv").write_text("table,benchmark\n", encoding="utf-8")
    with pytest.raises(ResultError, match="'method'"):
        read_source(tmp_path / "s.toml")
    (tmp_path / "s.toml").write_text(SOURCE.replace("url", "ulr"), encoding="utf-8")
    with pytest.raises(ResultError, match="'ulr'"):
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
