"""Reading tables: what is understood, and one message for each mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.table import read_published
from tests.audit.support import published, row

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


def test_units(tmp_path: Path) -> None:
    rows = [{**r, "unit": "share"} for r in row(R_1="0.5")]
    (cell,) = published(tmp_path, rows).cells
    assert (cell.full, cell.share.low) == (1, cell.number.interval.low)


def test_other_columns_are_named_and_left_alone(tmp_path: Path) -> None:
    rows = [{**r, "source": "page 3"} for r in row(R_1="5.0")]
    assert published(tmp_path, rows).unused_columns == ("source",)


def test_a_byte_order_mark_and_quoted_names(tmp_path: Path) -> None:
    read_cells = read(tmp_path, "\ufeff" + HEAD + '"A, ""best""",East,R@1,12.5\r\n')
    assert read_cells.cells[0].method == 'A, "best"'  # type: ignore[attr-defined]


BAD = {
    "empty": ("", ["no column 'method'", "found: none", "fix:"]),
    "no rows": (HEAD, ["no printed number"]),
    "only dashes": (HEAD + "A,East,R@1,-\n", ["no printed number"]),
    "missing column": ("method,scene,value\nA,E,5\n", ["no column 'metric'", "docs/audit.md"]),
    "mistyped column": (
        "method,scene,metric,value,bould\nA,E,R@1,50,1\n",
        ["unknown column 'bould'", "did you mean 'bold'"],
    ),
    "column twice": ("method,scene,metric,value,value\n", ["'value'", "keep one"]),
    "two gains": ("method,scene,metric,value,gain,printed_delta\n", ["'gain'", "keep one"]),
    "not a number": (
        HEAD + "A,E,R@1,5x\n",
        ["line 2, column 'value'", "what is 'x'", "such as 96.21"],
    ),
    "comma as point or not": (HEAD + 'A,E,R@1,"1,234"\n', ["line 2", "may be 1234 or 1.234"]),
    "two commas": (HEAD + 'A,E,R@1,"1,2,3"\n', ["line 2", "no printed number"]),
    "a deviation": (HEAD + "A,E,R@1,96.21 ± 0.3\n", ["what is '± 0.3'", "leave deviations"]),
    "no sign": (HEAD + "A,E,R@1,96.21 (1.73)\n", ["what is '(1.73)'", "a gain has a sign"]),
    "a footnote": (HEAD + "A,E,R@1,96.21†\n", ["what is '†'", "footnotes out"]),
    "two gains that differ": (
        HEAD[:-1] + ",gain\nA,E,R@1,5 (+1.0),+2.0\n",
        ["column 'gain'", "gain +2.0 here and +1.0 next to"],
    ),
    "nan": (HEAD + "A,E,R@1,nan\n", ["line 2", "'nan'"]),
    "huge": (HEAD + f"A,E,R@1,{'9' * 400}\n", ["line 2", "no printed number"]),
    "unrounded": (HEAD + "A,E,R@1,0.12345678901\n", ["more than 9 decimals"]),
    "bad gain": (
        HEAD[:-1] + ",gain\nA,E,R@1,5,+x\n",
        ["column 'gain'", "'+x' is no printed number"],
    ),
    "too many fields": (HEAD + "A,E,R@1,5,6\n", ["line 2", "double quotes"]),
    "too few fields": (HEAD + "A,E,R@1\n", ["line 2", "as many fields"]),
    "no method": (HEAD + ",E,R@1,5\n", ["line 2", "no method"]),
    "bad bold": (HEAD[:-1] + ",bold\nA,E,R@1,5,B\n", ["bold is 'B'", "1 or 0"]),
    "bad n": (HEAD[:-1] + ",n\nA,E,R@1,5,-3\n", ["n is '-3'"]),
    "n zero": (HEAD[:-1] + ",n\nA,E,R@1,5,0\n", ["n is '0'"]),
    "bad unit": (HEAD[:-1] + ",unit\nA,E,R@1,5,m\n", ["unit 'm'", "% or share"]),
    "cell twice": (HEAD + "A,E,R@1,5\nA,E,R@1,5\n", ["line 3", "again", "line 2", "'table'"]),
    "percent or share": (HEAD + "A,E,R@1,0.5\n", ["at most 1", "column 'unit'"]),
    "open quote": (HEAD + 'A,E,R@1,"5\n', ["not valid CSV"]),
    "not text": (b"\xff\xfe\x00", ["not UTF-8"]),
    "NUL": (HEAD + "A\0,E,R@1,x\n", ["line 2"]),
    "too large": (HEAD + "A,E,R@1,5\n" * 300_000, ["too large"]),
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


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no such"):
        read_published(tmp_path / "none.csv")
    with pytest.raises(ResultError, match="a folder"):
        read_published(tmp_path)
