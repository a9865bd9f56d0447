"""Small tables as authors type them: what is wrong is found, and what is right is left alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import Audit
from airzoo_bench.tables.printed.table import read_published
from tests.audit.support import told


def page(head: str, *rows: str) -> str:
    rule = " | ".join("-" for _ in head.split("|"))
    return "".join(f"| {line} |\n" for line in (head, rule, *rows))


def audited(folder: Path, text: str, suffix: str = "md") -> Audit:
    path = folder / f"t.{suffix}"
    path.write_text(text, encoding="utf-8")
    return audit(read_published(path))


RIGHT = {
    "accuracy and completeness in percent, beside F1": page(
        "Method | Accuracy | Completeness | F1",
        "X | **92.0** | **80.0** | **85.6**",
        "Y | 90.0 | 70.0 | 78.8",
    ),
    "accuracy whose arrow says that it is no distance": page(
        "Method | Acc ↑ | Comp ↑", "X | **92.0** | **80.0**", "Y | 90.0 | 70.0"
    ),
    "gains in percent of the other": page(
        "Method | R@1 | R@5 | Median error (m)",
        "X | 50.00 | 61.70 | 5.00",
        "X (ours) | 55.00 (+10%) | 63.20 (+2.43%) | 4.00 (-20%)",
    ),
    "gains in percent points": page(
        "Method | R@1 | R@5", "X | 50.00 | 60.00", "X (ours) | 55.00 (+5.00%) | 63.00 (+3.00%)"
    ),
    "lower is better": page(
        "Method | ATE ↓ | LPIPS ↓ | PSNR ↑",
        "X | **0.1** | **0.2** | 20.0",
        "Y | 0.3 | 0.4 | **21.0**",
    ),
    "areas under recalls": page("Method | AUC@5° | AUC@10° | AUC@20°", "X | 50.0 | 60.0 | 70.0"),
    "ties, and underlined seconds": page(
        "Method | R@1 | R@5", "X | **50.0** | <u>60.0</u>", "Y | **50.0** | **61.0**"
    ),
}
WRONG = {
    "an area under recalls that shrinks": (
        page("Method | AUC@5° | AUC@10°", "X | 50.0 | 40.0"),
        ("impossible", "order", "X", "AUC@5°"),
    ),
    "a share of pairs that shrinks": (
        page("Method | RRA@5 | RRA@15", "X | 50.0 | 40.0"),
        ("impossible", "order", "X", "RRA@5"),
    ),
    "a gain that is right in neither way": (
        page(
            "Method | R@1 | R@5 | R@10",
            "X | 50.00 | 60.00 | 70.00",
            "X (ours) | 55.00 (+10%) | 63.00 (+5%) | 77.00 (+17%)",
        ),
        ("inconsistent", "gain", "X (ours)", "R@10"),
    ),
    "bold against the arrow of a score that is not known": (
        page("Method | LPIPS ↓", "X | 0.2 ", "Y | **0.4**"),
        ("inconsistent", "bold", "Y", "LPIPS"),
    ),
    "an overall that is not the mean of accuracy and completeness": (
        page(
            "Method | Acc. ↓ | Comp. ↓ | Overall ↓",
            "X | 0.30 | 0.20 | 0.25",
            "Y | 0.40 | 0.20 | 0.35",
            "Z | 0.50 | 0.20 | 0.35",
        ),
        ("inconsistent", "Chamfer", "Y", "Overall"),
    ),
    "columns that were swapped": (
        page("Method | R@5 | R@1", "X | 40.0 | 60.0"),
        ("impossible", "order", "X", "R@1"),
    ),
    "a Unicode minus": (
        page("Method | R@1", "X | 50.00", "X (ours) | 48.00 (−3.00)"),
        ("inconsistent", "gain", "X (ours)", "R@1"),
    ),
    "decimal commas": (
        page(
            "Method | City R@1 | Rural R@1 | Average R@1",
            *(
                "X | 50,00 | 60,00 | 57,00",
                "Y | 40,00 | 60,00 | 50,00",
                "Z | 30,00 | 60,00 | 45,00",
            ),
        ),
        ("inconsistent", "average", "X", "R@1"),
    ),
}


@pytest.mark.parametrize("name", RIGHT)
def test_nothing_is_found(tmp_path: Path, name: str) -> None:
    assert told(audited(tmp_path, RIGHT[name])) == []


@pytest.mark.parametrize("name", WRONG)
def test_it_is_found(tmp_path: Path, name: str) -> None:
    text, finding = WRONG[name]
    found = told(audited(tmp_path, text))
    assert finding in found
    # Bold on the wrong one is missing on the right one.
    assert {f[:2] for f in found} == {finding[:2]}


@pytest.mark.parametrize("n", ["(161)", "(n=161)", "($n = 161$)", "(161 queries)"])
def test_queries_in_heads(tmp_path: Path, n: str) -> None:
    head = rf"Method & \multicolumn{{2}}{{c}}{{City {n}}} \\ & R@1 & R@5 \\ \midrule"
    table = rf"\begin{{tabular}}{{lcc}} {head} A & 12.00 & 24.84 \\ \end{{tabular}}"
    found = audited(tmp_path, table, "tex")
    assert told(found) == [("impossible", "counts", "A", "R@1")]


def test_footnotes_of_any_kind(tmp_path: Path) -> None:
    table = r"""\begin{tabular}{lcc}
Method & R@1 & R@5 \\
X & 50.00$^{2}$ & 60.00 \\
Y & 40.00\footnote{From the paper, table 3.} & 30.00\tnote{a} \\
\end{tabular}
\begin{tabular}{lc} Method & R@1 \\ Z & 50.0 \\ \end{tabular}
"""
    found = audited(tmp_path, table, "tex")
    assert [f.cell.number.text for f in found.findings] == ["40.00"]
    assert any("'50.00$^{2}$' in line 3" in note for note in found.notes)


def test_a_table_without_a_readable_number_says_which(tmp_path: Path) -> None:
    tables = page("Method | R@1", "X | 5.0 of 6.0") + "\n" + page("Method | R@1", "Y | 5.0")
    found = audited(tmp_path, tables)
    assert any("no printed number; columns left out" in note for note in found.notes)
