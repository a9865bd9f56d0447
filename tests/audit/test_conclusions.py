"""What is concluded from whole tables, as people type them: definitions, styles, units."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import Audit
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
    digit = typed(tmp_path, RETRIEVAL.replace("8.94", "8.98"), City=161, Rural=190)
    assert told(digit) == [("inconsistent", "AP counts", "MegaLoc", "AP@5")]


def test_nothing_is_concluded_from_an_impossible_row(tmp_path: Path) -> None:
    rows = "method,scene,R@1,R@5,AP@5\nA,City,7.45,28.57,7.20\nB,City,27.37,23.16,3.42\n"
    found = typed(tmp_path, rows)
    assert told(found) == [("impossible", "order", "B", "R@1")]
    (text,) = (c for c in found.conclusions if c.startswith("AP of"))
    assert "it cannot be told which" in text


def test_scores_of_clouds_grow_with_the_distance(tmp_path: Path) -> None:
    found = typed(tmp_path, "method,scene,F1@1m,F1@5m,P@5m\nA,s1,50.00,40.00,60.00\n")
    assert told(found) == [("impossible", "order", "A", "F1@1m")]


def test_pooled_is_over_all_queries(tmp_path: Path) -> None:
    rows = "method,scene,n,R@1\nA,City,10,10.00\nA,Rural,90,90.00\nA,Average,,50.00\n"
    assert not typed(tmp_path, rows + "A,Pooled,100,82.00\n").findings
    found = typed(tmp_path, rows + "A,Pooled,100,50.00\n")
    assert told(found) == [("inconsistent", "average", "A", "R@1")]
