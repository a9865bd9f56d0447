"""Published numbers: digits, names and marks that are understood of a file."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.published import published_sources, read_published, read_source

SOURCE_HEAD = "table,benchmark,track,method,scene,metric,unit,value\n"
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


def test_digits_names_and_what_stands_beside_a_number(tmp_path: Path) -> None:
    text = "\ufeffmethod,scene,metric,value,n,bold,printed_delta\r\n"
    text += '"A, ""best""",City,R@1,8.70,161,1,+1.24\r\nB,City,R@1,–,,,\r\nB,Average,F1,−7,,0,-\r\n'
    (tmp_path / "table.csv").write_text(text, "utf-8")
    first, second = read_published(tmp_path / "table.csv")
    assert (first.method, str(first.value), first.n) == ('A, "best"', "8.70", 161)
    assert (first.bold, first.gain, first.line) == (True, Decimal("1.24"), 2)
    assert (second.value, second.line, second.is_summary, second.bold) == (-7, 4, True, False)
    assert second.gain is None


def test_a_source_is_read_by_the_names_of_the_suite(tmp_path: Path) -> None:
    table, source = tmp_path / "s.csv", tmp_path / "s.toml"
    source.write_text(SOURCE, encoding="utf-8")
    table.write_text(SOURCE_HEAD + "t,B,retrieval,M,Avg,R@1,share,0.125\n", "utf-8")
    [value] = read_source(source)
    assert (value.table, value.benchmark, value.scene) == ("s, t", "b", "")
    assert (value.metric, value.value) == ("recall@1", Decimal("12.5"))
    for line, name in (("C,retrieval,M,East,R@1", "C"), ("B,matching,M,East,R@1", "matching")):
        table.write_text(f"{SOURCE_HEAD}t,{line},,2\n", encoding="utf-8")
        with pytest.raises(ResultError, match=f"line 2: .*'{name}'"):
            read_source(source)
    assert len(read_source(published_sources()["airzoo-paper"])) == 473
