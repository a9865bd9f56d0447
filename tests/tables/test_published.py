"""Sources of published numbers: another paper's, and pairs of files that do not fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.published import published_sources, read_source

SOURCE = """
schema = 1
name = "s"
title = "S"
url = "u"
data = "s.csv"
[benchmarks]
"B" = "b"
[scores.retrieval]
"R@1" = "recall@1"
[citations]
"""
HEAD = "table,benchmark,track,method,scene,metric,unit,value\n"


def source(folder: Path, table: str) -> Path:
    (folder / "s.csv").write_text(table, encoding="utf-8")
    (folder / "s.toml").write_text(SOURCE, encoding="utf-8")
    return folder / "s.toml"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("t,C,retrieval,M,East,R@1,,2\n", "line 2, column 'benchmark': .*'C'"),
        ("t,B,retrieva,M,East,R@1,,2\n", "line 2, column 'track': .*'retrieval'"),
        ("t,B,matching,M,East,R@1,,2\n", "line 2, column 'track': .*'matching'"),
        ("t,B,retrieval,M,East,R@5,,2\n", "line 2, column 'metric': .*'R@5'"),
        ("t,B,retrieval,M,East,R@1,,x\n", "line 2, column 'value': .*'x'"),
        (
            "t,B,retrieval,M,overall,R@1,,2\nt,B,retrieval,M,Average,R@1,,2\n",
            "line 3: M has R@1 twice",
        ),
    ],
)
def test_a_pair_that_does_not_fit(tmp_path: Path, table: str, message: str) -> None:
    with pytest.raises(ResultError, match=message):
        read_source(source(tmp_path, HEAD + table))


def test_the_shipped_pair_is_read() -> None:
    tables = read_source(published_sources()["airzoo-paper"])
    numbers = [
        value
        for table in tables
        for scenes in table.values.values()
        for scores in scenes.values()
        for value in scores.values()
    ]
    assert len(numbers) == 473
