"""Pages of leaderboards: lines that end early, HTML beside Markdown, and no table at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.table import read_published

# From the leaderboard beside layumi/University1652-Baseline: 701 satellite queries, which it does
# not say, rows that end early, and a line of words below the head.
UNIVERSITY = """
|Methods | R@1 | AP | R@1 | AP | Reference |
| -------- | ----- | ---- | ---- |  ---- |  ---- |
|| Drone -> Satellite | | Satellite -> Drone |  |
|Contrastive Loss | 52.39 | 57.44 | 63.91 | 52.24|
|Triplet Loss (margin=0.3)  | 55.18 | 59.97 | 63.62 | 53.85 |
|Triplet Loss (margin=0.5)  | 53.58 | 58.60 | 64.48 | 53.15 |
|Weighted Soft Margin Triplet Loss | 53.21 | 58.03 | 65.62 | 54.47| Liu and Li |
|Instance Loss | 58.23 | 62.91 | 74.47 | 59.45 | Zheng et al. |
|Instance Loss + Verification Loss | 61.30 | 65.68 | 75.04 | 62.87| Zheng et al. |
|Instance Loss + GeM Pooling | 65.32\t| 69.61\t| 79.03\t| 65.35| |
|Instance Loss + USAM + SAFA | 72.19 | 75.79 | 83.23 | 71.77 |
|LPN | 75.93 | 79.14 | 86.45 | 74.79 | [[Code]](https://example.org) |
|Instance Loss + USAM + LPN | 77.60 | 80.55 | 86.59 | 75.96 |
|SAIG-D| 78.85 | 81.62 | 86.45 | 78.48 |
|LDRVSD| 78.66 | 81.55 | 89.30 | 79.17 |
|FSRA (k=1)| 82.25 | 84.82 | 87.87 | 81.53 |
|TransFG| 84.01 | 86.31 | 90.16 | 84.61 |
|PAAN | 84.51 | 86.78 | 91.01 | 82.28 |
|Instance Loss + GNN ReRanking |70.30| 74.11 | - | - | Zhang et al. |
|Sample4Geo | 92.65 | 93.81 | 95.14 | 91.39 |
|*: a footnote | |
"""


def test_a_leaderboard_with_lines_that_end_early(tmp_path: Path) -> None:
    path = tmp_path / "t.md"
    path.write_text(UNIVERSITY)
    cells = {(c.method, c.scene, c.score.name): c.number.text for c in read_published(path).cells}
    assert cells["Contrastive Loss", "Drone -> Satellite", "AP"] == "57.44"
    assert cells["Contrastive Loss", "Satellite -> Drone", "AP"] == "52.24"
    assert ("Instance Loss + GNN ReRanking", "Satellite -> Drone", "R@1") not in cells
    found = audit(read_published(path))
    said = [c.text for c in found.conclusions if "Satellite -> Drone" in c.place]
    assert said[0].startswith("n = 701 fits 13 of 15 different values")
    # 667/701 is 95.1498: cut off; no whole number is near 83.23.
    assert [(f.grade.value, f.check, f.cell.number.text) for f in found.findings] == [
        ("inconsistent", "counts", "83.23"),
        ("rounding", "counts", "95.14"),
    ]


def test_more_fields_than_the_head_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.md"
    path.write_text("| Method | R@1 |\n|-|-|\n| X | 5.0 | | |\n")
    assert [cell.number.text for cell in read_published(path).cells] == ["5.0"]
    path.write_text("| Method | R@1 |\n|-|-|\n| X | 5.0 | 6.0 |\n")
    with pytest.raises(ResultError, match=r"not as many fields \(3\) as the first \(2\)"):
        read_published(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# A page\n\nNothing, but words.\n", "no table"),
        ("# A page\n\n<table>\n<tr><td>5.0</td></tr>\n</table>\n", "HTML are not read: 1"),
    ],
)
def test_a_page_without_a_table_that_is_read(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(ResultError, match=said):
        read_published(path)


def test_html_beside_markdown_is_said(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    path.write_text(
        "<table><tr><td>1</td></tr></table>\n\n| Method \\ Scene | A R@1 | B R@1 |\n|-|-|-|\n"
        '| X | <span style="color: red">**5.0**</span> | 6.0 |\n'
    )
    page = read_published(path)
    assert [(c.method, c.scene, c.number.text, c.bold) for c in page.cells] == [
        ("X", "A", "5.0", True),
        ("X", "B", "6.0", False),
    ]
    assert "tables in HTML are not read: 1" in page.notes


def test_several_numbers_in_a_field_are_the_reason(tmp_path: Path) -> None:
    # As beside cvg/Hierarchical-Localization.
    path = tmp_path / "README.md"
    path.write_text("| Methods | Aachen day |\n|-|-|\n| D2Net | 84.6 / 91.4 / 97.1 |\n")
    with pytest.raises(ResultError, match=r"in which '84.6 / 91.4 / 97.1' is not one number"):
        read_published(path)


def test_only_tables_are_counted_where_none_can_be_read(tmp_path: Path) -> None:
    table = "\\begin{tabular}{lc} Dataset & Images \\\\ One & 5 \\\\ \\end{tabular}\n"
    path = tmp_path / "t.tex"
    path.write_text("\\input{other}\n" + table * 2)
    with pytest.raises(ResultError, match="none of 2 tables can be read: left out"):
        read_published(path)
