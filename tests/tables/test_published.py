"""Published numbers: what is understood of a file, and a message for what is not."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.published import (
    PrintedValue,
    published_sources,
    read_published,
    read_source,
)

HEAD = "method,scene,metric,value\n"
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


def read(folder: Path, content: str | bytes) -> list[PrintedValue]:
    path = folder / "table.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_published(path)


def test_digits_names_and_what_stands_beside_a_number(tmp_path: Path) -> None:
    text = "\ufeffmethod,scene,metric,value,n,bold,printed_delta\r\n"
    text += '"A, ""best""",City,R@1,8.70,161,1,+1.24\r\nB,City,R@1,–,,,\r\nB,Average,F1,−7,,0,-\r\n'
    first, second = read(tmp_path, text)
    assert (first.method, str(first.value), first.n) == ('A, "best"', "8.70", 161)
    assert (first.bold, first.gain, first.line) == (True, Decimal("1.24"), 2)
    assert (second.value, second.line, second.is_summary, second.bold) == (-7, 4, True, False)
    assert second.gain is None


BAD = {
    "empty": ("", []),
    "only dashes": (HEAD + "A,East,R@1,-\n", []),
    "missing column": ("method,scene,value\nA,E,5\n", ["metric", "docs/audit.md"]),
    "mistyped column": ("method,scene,metric,value,bould\nA,E,R@1,50,1\n", ["'bould'", "'bold'"]),
    **{
        f"value {value[:9]}": (HEAD + f'A,E,R@1,"{value}"\n', ["line 2", "'value'", value[:5]])
        for value in ("5x", "1,234", "96.21 ± 0.3", "nan", "9" * 400)
    },
    "bad gain": (HEAD[:-1] + ",gain\nA,E,R@1,5,+x\n", ["line 2", "gain", "'+x'"]),
    "too many fields": (HEAD + "A,E,R@1,5,6\n", ["line 2"]),
    "too few fields": (HEAD + "A,E,R@1\n", ["line 2"]),
    "no method": (HEAD + ",E,R@1,5\n", ["line 2", "'method'"]),
    "bad bold": (HEAD[:-1] + ",bold\nA,E,R@1,5,B\n", ["line 2", "'bold'", "'B'"]),
    "n zero": (HEAD[:-1] + ",n\nA,E,R@1,5,0\n", ["line 2", "'n'", "'0'"]),
    "cell twice": (HEAD + "A,E,R@1,5\nA,E,R@1,5\n", ["line 3", "line 2", "'table'"]),
    "open quote": (HEAD + 'A,E,R@1,"5\n', ["CSV"]),
    "not text": (b"\xff\xfe\x00", ["UTF-8"]),
}


@pytest.mark.parametrize("name", BAD)
def test_a_mistake_gets_a_message(name: str, tmp_path: Path) -> None:
    content, fragments = BAD[name]
    with pytest.raises(ResultError, match=r"table\.csv") as raised:
        read(tmp_path, content)
    assert len(str(raised.value)) < 800
    for fragment in fragments:
        assert fragment in str(raised.value)


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
