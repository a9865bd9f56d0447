"""Tables as people have them: wide ones, other separators, marks in the fields, LaTeX, Markdown."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.annotations import Marked, plain_name, read_marked
from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.scores import Family
from airzoo_bench.tables.printed.table import read_published
from tests.tables.printed.typed import BAD, FIELDS, HEADS, LAYOUTS, SAME, WHOLE, WIDE


def read(folder: Path, text: str) -> tuple[PrintedValue, ...]:
    path = folder / "table.csv"
    path.write_bytes(text.encode())
    return read_published(path).cells


def values(cells: tuple[PrintedValue, ...]) -> list[tuple[str, str, str, str]]:
    return [(c.method, c.scene, c.score.name, c.number.text) for c in cells]


@pytest.mark.parametrize("text", FIELDS)
def test_a_field(text: str) -> None:
    marked = read_marked(text)
    assert isinstance(marked, Marked), marked
    gain = marked.gain.text if marked.gain else None
    assert (marked.number.text, gain, marked.bold, marked.percent) == FIELDS[text]


@pytest.mark.parametrize(
    "text",
    ["", "x", "1,234", "1,234.5", "1.2.3", "96.21 (1.73)", "96.21 ± 1", "96.21 / 3", "5†", "%"],
)
def test_what_is_no_field(text: str) -> None:
    assert isinstance(read_marked(text), str)


def test_names_without_marks() -> None:
    assert plain_name(r"\textbf{RoMA}~\cite{edstedt2024roma} (Ours)") == "RoMA (Ours)"
    assert plain_name(r"A\&B\_1") == "A&B_1"


def test_a_wide_table(tmp_path: Path) -> None:
    cells = read(tmp_path, WIDE)
    assert values(cells) == [
        ("X", "City", "R@1", "8.70"),
        ("X", "City", "R@5", "24.84"),
        ("X", "City", "Med.", "3.2"),
        ("X", "Rural", "R@1", "4.21"),
        ("X", "Rural", "Med.", "2.5"),
    ]
    assert [cell.line for cell in cells] == [2, 2, 2, 3, 3]
    assert [cell.bold for cell in cells] == [False, True, False, False, False]
    assert [cell.unit for cell in cells][:3] == ["", "%", "m"]
    assert {cell.queries for cell in cells} == {161, 190}


def test_wide_is_audited_as_long(tmp_path: Path) -> None:
    cells = "A,City,96.23 (+2.00)\nB,City,94.23\n"
    (tmp_path / "t.csv").write_text("method,scene,R@1\n" + cells)
    found = audit(read_published(tmp_path / "t.csv"), {"City": 264})
    assert [(f.grade.value, f.check, f.cell.method) for f in found.findings] == [
        ("impossible", "counts", "A"),
        ("impossible", "counts", "B"),
    ]


def test_a_wide_table_without_scenes(tmp_path: Path) -> None:
    assert values(read(tmp_path, "method,R@1\nX,5.0\n")) == [("X", "overall", "R@1", "5.0")]


def test_columns_of_gains(tmp_path: Path) -> None:
    (cell,) = read(tmp_path, "method,R@1,R@1 gain,Marked\nX,5.0,+1.0,yes\n")
    assert cell.gain is not None
    assert cell.gain.text == "+1.0"


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts(name: str, tmp_path: Path) -> None:
    assert values(read(tmp_path, LAYOUTS[name])) == SAME


@pytest.mark.parametrize("name", BAD)
def test_what_is_refused(name: str, tmp_path: Path) -> None:
    text, fragments = BAD[name]
    with pytest.raises(ResultError) as raised:
        read(tmp_path, text)
    for fragment in fragments:
        assert fragment in str(raised.value)


def test_accuracy_in_percent_is_no_distance(tmp_path: Path) -> None:
    (cell,) = read(tmp_path, "method,Accuracy\nX,87.5%\n")
    assert cell.score.higher_is_better is True
    (alone,) = read(tmp_path, "method,Accuracy\nX,87.5\n")
    assert alone.score.higher_is_better is None
    cloud = read(tmp_path, "method,Accuracy,Completeness\nX,0.5,0.7\n")
    assert [cell.score.higher_is_better for cell in cloud] == [False, False]


def test_a_whole_latex_table(tmp_path: Path) -> None:
    cells = read(tmp_path, WHOLE)
    assert values(cells) == [
        ("X", "City", "R@1", "8.70"),
        ("X", "City", "R@5", "24.84"),
        ("X", "Rural", "R@1", "4.21"),
        ("X", "Rural", "R@5", "11.05"),
        ("Y (Ours)", "City", "R@1", "9.94"),
        ("Y (Ours)", "City", "R@5", "31.06"),
        ("Y (Ours)", "Rural", "R@1", "27.37"),
    ]
    assert [cell.line for cell in cells] == [13, 13, 13, 13, 14, 14, 14]
    assert [cell.bold for cell in cells] == [False] * 5 + [True, False]


def test_two_latex_tables_are_told_apart_by_their_labels(tmp_path: Path) -> None:
    cells = read(tmp_path, WHOLE + WHOLE.replace("tab:x", "tab:y"))
    assert [cell.table for cell in cells] == ["tab:x"] * 7 + ["tab:y"] * 7


@pytest.mark.parametrize("blank", ["", r"\rowcolor{gray}"])
def test_an_empty_name_is_the_one_above(tmp_path: Path, blank: str) -> None:
    table = f"Method & Scene & R@1 \\\\\nX & City & 8.70 \\\\\n{blank} & Rural & 4.21 \\\\\n"
    (tmp_path / "t.tex").write_text(table)
    published = read_published(tmp_path / "t.tex")
    assert [(c.method, c.scene) for c in published.cells] == [("X", "City"), ("X", "Rural")]
    assert published.notes == ("an empty name is read as the one above it: line 3",)


def test_a_caption_above_markdown(tmp_path: Path) -> None:
    text = "Table 1: results\n\n" + LAYOUTS["Markdown"] + "\nfoot | note\n"
    assert values(read(tmp_path, text)) == SAME
    bare = "Method | Scene | R@1\n--- | --- | ---\nX | City | 8.70\nY, Z | City | 9.94\n"
    assert values(read(tmp_path, bare)) == SAME


@pytest.mark.parametrize("heads", HEADS)
def test_scenes_in_the_heads(tmp_path: Path, heads: str) -> None:
    names = next(csv.reader([heads.replace("(5m, 1deg)", "(5m; 1deg)")]))
    text = ";".join(name.replace(";", ",") for name in names) + "\nX" + ";5.00" * (len(names) - 1)
    assert [(c.scene, c.score.name) for c in read(tmp_path, text + "\n")] == HEADS[heads]


def test_a_table_of_one_method_need_not_name_it(tmp_path: Path) -> None:
    cells = read(tmp_path, "Scene,Queries,R@1,Chamfer\nCity,59,8.47,inf\nPooled,59,8.47,2.0\n")
    assert [(c.method, c.scene, c.queries) for c in cells[:1]] == [("(unnamed)", "City", 59)]
    assert [c.number.text for c in cells] == ["8.47", "8.47", "2.0"]
    assert [c.is_pooled for c in cells] == [False, True, True]


@pytest.mark.parametrize(
    ("heads", "families"),
    [
        ("P@10m [%],R@10m [%],F1@10m [%]", [Family.PRECISION, Family.RECALL, Family.F1]),
        ("Precision@10,Recall@10,F1@10", [Family.PRECISION, Family.RECALL, Family.F1]),
        ("Precision@10,Recall@10,F1@5", [Family.AVERAGE_PRECISION, Family.HITS, Family.F1]),
        ("AP@10,R@10m,F1@5m", [Family.AVERAGE_PRECISION, Family.HITS, Family.F1]),
        ("P@5m,R@5m,R@1", [Family.PRECISION, Family.RECALL, Family.HITS]),
    ],
)
def test_f1_beside_them_makes_recall_and_precision_those_of_clouds(
    tmp_path: Path, heads: str, families: list[Family]
) -> None:
    cells = read(tmp_path, f"method,scene,{heads}\nA,s1,70.10,40.20,51.10\n")
    assert [cell.score.family for cell in cells] == families
