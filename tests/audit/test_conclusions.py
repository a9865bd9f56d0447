"""What is concluded from whole tables, as people type them: definitions, styles, units."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import Audit, audit_text
from tests.audit.support import published, rows_of_wide, told


def typed(folder: Path, text: str, **counts: int) -> Audit:
    return audit(published(folder, rows_of_wide(text)), counts)


RETRIEVAL = """method,scene,R@1,R@3,R@5,AP@5
AnyLoc,City,3.73,8.70,9.32,2.61
SALAD,City,8.70,21.12,31.06,8.07
MegaLoc,City,9.94,22.98,31.06,8.94
AnyLoc,Rural,5.26,10.00,11.58,3.26
SALAD,Rural,6.32,17.89,28.42,7.37
MegaLoc,Rural,27.37,58.42,70.00,24.74
"""


def test_one_bad_value_does_not_hide_the_definition(tmp_path: Path) -> None:
    assert not typed(tmp_path, RETRIEVAL).findings
    found = typed(tmp_path, RETRIEVAL.replace("24.74", "12.47"))
    assert ("inconsistent", "AP bounds", "MegaLoc", "AP@5") in told(found)
    assert "14.00 to" in next(f.why for f in found.findings if f.check == "AP bounds")
    digit = typed(tmp_path, RETRIEVAL.replace("8.94", "8.98"), City=161, Rural=190)
    assert told(digit) == [("inconsistent", "AP counts", "MegaLoc", "AP@5")]


def test_a_value_that_fits_no_definition_that_can_be_told_is_named(tmp_path: Path) -> None:
    lines = RETRIEVAL.replace("8.94", "8.95").splitlines()[:5]
    found = typed(tmp_path, "\n".join(lines) + "\n", City=161, Rural=190)
    (text,) = (c.text for c in found.conclusions if c.check == "AP")
    assert text.startswith("it cannot be told which")
    assert text.endswith("mean precision fits all but one, 8.95 of MegaLoc in City")


def test_nothing_is_concluded_from_an_impossible_row(tmp_path: Path) -> None:
    rows = "method,scene,R@1,R@5,AP@5\nA,City,7.45,28.57,7.20\nB,City,27.37,23.16,3.42\n"
    found = typed(tmp_path, rows)
    assert told(found) == [("impossible", "order", "B", "R@1")]
    (text,) = (c.text for c in found.conclusions if c.check == "AP")
    assert text.startswith("it cannot be told which")


def test_few_values_tell_no_definition(tmp_path: Path) -> None:
    found = typed(tmp_path, "method,R@1,R@5,AP@5\nA,90.00,90.00,20.00\n")
    (text,) = (c.text for c in found.conclusions if c.check == "AP")
    assert text.startswith("it cannot be told which")


def test_columns_without_bold_are_a_style(tmp_path: Path) -> None:
    rows = "A,s1,50.10,60.10\nB,s1,51.10,62.10\nA,s2,30.10,60.10\nB,s2,31.10,62.10\n"
    averages = "A,mean,40.10,60.10\nB,mean,**41.10**,**62.10**\n"
    found = typed(tmp_path, "method,scene,R@1,R@5\n" + rows + averages)
    assert not found.findings
    (outcome,) = (o for o in found.outcomes if o.check == "bold")
    assert outcome.tested == 2
    assert (
        "4 columns in which nothing is bold (R@1 of s1, R@5 of s1, R@1 of s2 ...)" in outcome.left
    )
    wrong = typed(
        tmp_path, "method,scene,R@1,R@5\n" + rows + averages.replace("40.10", "**40.10**")
    )
    assert told(wrong, "bold") == [("inconsistent", "bold", "A", "R@1")]


@pytest.mark.parametrize(
    ("rows", "odd"),
    [
        ("A,0.1950,0.3882\nB,28.64,53.74\n", ["0.1950", "0.3882"]),
        ("A,0.87,0.95\nB,87,95\nC,8.70,24.84\n", ["0.87", "0.95"]),
        ("A,0.00,0.3882\nB,28.64,53.74\n", ["0.3882"]),
        ("A,0.62,0.98\nB,28.64,53.74\n", []),
        ("A,0.6,0.9\nB,28,53\n", []),
        ("A,0.1950,1.3882\nB,28.64,53.74\n", []),
    ],
)
def test_shares_among_percent(tmp_path: Path, rows: str, odd: list[str]) -> None:
    found = typed(tmp_path, "method,R@1,R@5\n" + rows)
    assert [f.cell.number.text for f in found.findings if f.check == "units"] == odd


def test_f1_at_a_distance(tmp_path: Path) -> None:
    for heads in ("P@10m [%],R@10m [%],F1@10m [%]", "Precision@10,Recall@10,F1@10"):
        rows = "A,s1,70.10,40.20,61.10\nA,s2,70.10,40.20,51.10\n"
        found = typed(tmp_path, f"method,scene,{heads}\n{rows}")
        assert [finding[:2] for finding in told(found)] == [("impossible", "F1")]
        assert "= 51.10, printed is 61.10" in found.findings[0].why


def test_scores_of_clouds_grow_with_the_distance(tmp_path: Path) -> None:
    found = typed(tmp_path, "method,scene,F1@1m,F1@5m,P@5m\nA,s1,50.00,40.00,60.00\n")
    assert told(found) == [("impossible", "order", "A", "F1@1m")]


def test_the_first_line_says_how_much_could_be_checked(tmp_path: Path) -> None:
    none = typed(tmp_path, "method,beauty,charm\nA,1.0,2.0\n")
    assert none.summary.endswith("none of 2 values could be checked, apart from their range")
    assert "Nothing could be checked, so nothing was found." in audit_text(none, 80)
    some = typed(tmp_path, "method,R@1,R@5,charm\nA,1.0,2.0,3.0\n")
    assert some.summary.endswith("only 2 of 3 values could be checked, apart from their range")
    every = typed(tmp_path, "method,R@1,R@5\nA,1.0,2.0\n")
    assert every.summary.endswith("in 2 values")


def test_two_tables_that_differ_are_summed_up(tmp_path: Path) -> None:
    scenes = "s,A,S1,10.00,20.00\ns,A,S2,20.00,40.00\ns,A,Average,15.00,30.00\n"
    scenes += scenes.replace(",A,", ",B,")
    other = "m,A,overall,16.00,31.00\nm,B,overall,15.00,30.00\n"
    text = "table,method,scene,R@1,R@5\n" + scenes + other
    found = typed(tmp_path, text, S1=10, S2=10)
    assert found.overview == (
        "2 of the 4 numbers that both s and m print differ by more than the last digit: 2 of the "
        "inconsistencies are this one fact",
    )
    assert audit_text(found, 100).splitlines()[1].startswith("2 of the 4 numbers")


def test_pooled_is_over_all_queries(tmp_path: Path) -> None:
    rows = "method,scene,n,R@1\nA,City,10,10.00\nA,Rural,90,90.00\nA,Average,,50.00\n"
    assert not typed(tmp_path, rows + "A,Pooled,100,82.00\n").findings
    found = typed(tmp_path, rows + "A,Pooled,100,50.00\n")
    assert told(found) == [("inconsistent", "average", "A", "R@1")]
