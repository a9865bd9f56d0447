"""Printed names of scores, and units of values."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

from airzoo_bench.audit.values import Family, read_score, read_values
from airzoo_bench.core.errors import ResultError
from tests.audit.support import Rows, published, rows_of


@pytest.mark.parametrize(
    ("name", "family", "higher"),
    [
        ("R@1", Family.HITS, True),
        ("Recall@5", Family.HITS, True),
        ("recall@(5m,1deg)", Family.HITS, True),
        ("Acc@10m", Family.HITS, True),
        ("@20m", Family.HITS, True),
        ("R@1%", Family.HITS, True),
        ("AP@5", Family.AVERAGE_PRECISION, True),
        ("F1", Family.F1, True),
        ("F1 ↑", Family.F1, True),
        ("F-score", Family.F1, True),
        ("Precision", Family.PRECISION, True),
        ("Recall", Family.RECALL, True),
        ("Chamfer distance", Family.ERROR, False),
        ("CD", Family.ERROR, False),
        ("Accuracy", Family.DISTANCE, False),
        ("Comp", Family.DISTANCE, False),
        ("median_translation_error", Family.MEDIAN, False),
        ("Med. ↓", Family.MEDIAN, False),
        ("ATE", Family.ERROR, False),
        ("nDCG@10", Family.OTHER, True),
        ("mAP", Family.OTHER, True),
        ("beauty", Family.OTHER, None),
        ("AUC@5", Family.CURVE, True),
        ("R@", Family.OTHER, None),
        ("AP@0", Family.OTHER, None),
    ],
)
def test_families(name: str, family: Family, higher: bool | None) -> None:
    score = read_score(name)
    assert (score.family, score.higher_is_better) == (family, higher)


@pytest.mark.parametrize(
    ("name", "variant"),
    [("AP@5", None), ("AP@5/trec", "trec"), ("ap@5/min", "min"), ("P@5", "precision")],
)
def test_an_average_precision_may_name_its_definition(name: str, variant: str | None) -> None:
    score = read_score(name)
    assert (score.cutoff, score.variant) == (5, variant)


def rows(value: str, unit: str) -> Rows:
    return rows_of({"A": {"East": {"R@1": value}}}, unit=unit)


def test_units(tmp_path: Path) -> None:
    (value,) = read_values(published(tmp_path, rows("0.5", "share")))
    assert (value.full, value.share) == (1, value.span)
    (value,) = read_values(published(tmp_path, rows("50.0", "")))
    assert (value.full, value.share.low) == (100, Fraction(4995, 10000))


@pytest.mark.parametrize(("value", "unit"), [("5", "m"), ("0.5", "")])
def test_a_unit_that_leaves_open_what_is_meant(tmp_path: Path, value: str, unit: str) -> None:
    with pytest.raises(ResultError, match="'unit'") as raised:
        read_values(published(tmp_path, rows(value, unit)))
    assert "table.csv" in str(raised.value)
