"""Reading tables: what is understood, and one message for each mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.published import read_published
from tests.audit.support import published

HEAD = "method,scene,metric,value\n"


def read(folder: Path, content: str | bytes) -> object:
    path = folder / "table.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_published(path)


def test_the_simple_layout(tmp_path: Path) -> None:
    rows = [
        {"method": "A", "scene": "City", "metric": "R@1", "value": "8.70"}
        | {"n": 161, "bold": 1, "gain": "+1.24"},
        {"method": "B", "scene": "City", "metric": "R@1", "value": "–"},
        {"method": "B", "scene": "Average", "metric": "F1", "value": "7"},
    ]
    first, second = published(tmp_path, rows).cells
    assert (first.number.text, first.queries, first.bold, first.line) == ("8.70", 161, True, 2)
    assert first.gain is not None
    assert first.gain.text == "+1.24"
    assert (second.line, second.is_summary, second.bold, second.gain) == (4, True, False, None)


def test_a_byte_order_mark_and_quoted_names(tmp_path: Path) -> None:
    read_cells = read(tmp_path, "\ufeff" + HEAD + '"A, ""best""",East,R@1,12.5\r\n')
    assert read_cells.cells[0].method == 'A, "best"'  # type: ignore[attr-defined]


BAD = {
    "empty": ("", ["method"]),
    "no rows": (HEAD, []),
    "only dashes": (HEAD + "A,East,R@1,-\n", []),
    "missing column": ("method,scene,value\nA,E,5\n", ["metric", "docs/audit.md"]),
    "mistyped column": ("method,scene,metric,value,bould\nA,E,R@1,50,1\n", ["'bould'", "'bold'"]),
    "column twice": ("method,scene,metric,value,value\n", []),
    "two gains": ("method,scene,metric,value,gain,printed_delta\n", ["gain or printed_delta"]),
    "not a number": (HEAD + "A,E,R@1,5x\n", ["line 2", "'value'", "'5x'"]),
    "a comma": (HEAD + 'A,E,R@1,"1,234"\n', ["line 2", "'value'"]),
    "a deviation": (HEAD + "A,E,R@1,96.21 ± 0.3\n", ["line 2", "'value'"]),
    "nan": (HEAD + "A,E,R@1,nan\n", ["line 2", "'value'"]),
    "huge": (HEAD + f"A,E,R@1,{'9' * 400}\n", ["line 2", "'value'"]),
    "unrounded": (HEAD + "A,E,R@1,0.12345678901\n", ["line 2", "'value'"]),
    "bad gain": (HEAD[:-1] + ",gain\nA,E,R@1,5,+x\n", ["line 2", "'gain'", "'+x'"]),
    "too many fields": (HEAD + "A,E,R@1,5,6\n", ["line 2"]),
    "too few fields": (HEAD + "A,E,R@1\n", ["line 2"]),
    "no method": (HEAD + ",E,R@1,5\n", ["line 2", "'method'"]),
    "bad bold": (HEAD[:-1] + ",bold\nA,E,R@1,5,B\n", ["line 2", "'bold'", "'B'"]),
    "bad n": (HEAD[:-1] + ",n\nA,E,R@1,5,-3\n", ["line 2", "'n'", "'-3'"]),
    "n zero": (HEAD[:-1] + ",n\nA,E,R@1,5,0\n", ["line 2", "'n'", "'0'"]),
    "cell twice": (HEAD + "A,E,R@1,5\nA,E,R@1,5\n", ["line 3", "line 2", "'table'"]),
    "open quote": (HEAD + 'A,E,R@1,"5\n', ["line 2"]),
    "not text": (b"\xff\xfe\x00", ["UTF-8"]),
    "NUL": (HEAD + "A\0,E,R@1,x\n", ["line 2"]),
}


@pytest.mark.parametrize("name", BAD)
def test_a_mistake_gets_a_message(name: str, tmp_path: Path) -> None:
    content, fragments = BAD[name]
    with pytest.raises(ResultError) as raised:
        read(tmp_path, content)
    message = str(raised.value)
    assert "table.csv" in message
    assert len(message) < 800
    for fragment in fragments:
        assert fragment in message
