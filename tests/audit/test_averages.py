"""Whether some weights of the scenes explain several averages."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.audit.average_checks import Averaged, check_averages, has_common_weights
from airzoo_bench.audit.findings import Audit, audit_text
from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed_numbers import Interval, mean_interval
from tests.audit.honest import Manner, honest
from tests.audit.support import audited, published, rows_of


def averaged(folder: Path, scenes: tuple[str, ...], average: str) -> Averaged:
    values = {f"S{i}": {"R@1": value} for i, value in enumerate(scenes)}
    *parts, cell = published(folder, rows_of({"A": values | {"Average": {"R@1": average}}})).cells
    mean = mean_interval(part.number.interval for part in parts)
    everywhere = Interval(mean.low - 100, mean.high + 100)
    value = sum((part.number.value for part in parts), mean.low * 0) / len(parts)
    return Averaged(cell, tuple(parts), mean, everywhere, value, is_weighed=False)


@pytest.mark.parametrize(
    ("average", "possible"), [("8", False), ("9", True), ("10", True), ("11", True), ("12", False)]
)
def test_the_digits_leave_room(tmp_path: Path, average: str, possible: bool) -> None:
    assert has_common_weights([averaged(tmp_path, ("10", "10", "10"), average)]) is possible


@pytest.mark.parametrize(("last", "possible"), [("5.00", True), ("5.10", False)])
def test_weights_are_common_to_all(tmp_path: Path, last: str, possible: bool) -> None:
    # With weights of 1/4, 1/4 and 1/2.
    made = [
        averaged(tmp_path, ("10.00", "20.00", "40.00"), "27.50"),
        averaged(tmp_path, ("10.00", "30.00", "20.00"), "20.00"),
        averaged(tmp_path, ("0.00", "0.00", "10.00"), last),
    ]
    assert has_common_weights(made) is possible


def test_scenes_of_like_size_printed_coarsely(tmp_path: Path) -> None:
    # Most of these averages over queries happen to be means over scenes as well.
    manner = Manner(280, (314, 397, 399), "ROUND_DOWN", 0, pooled=True, all_bold=False)
    outcome = check_averages(published(tmp_path, honest(manner)), {}, {})
    assert not [finding for finding in outcome.findings if finding.grade.value != "rounding"]
    assert "--counts" in outcome.left


def audit_of_averages(folder: Path, *averages: str) -> Audit:
    """Audit methods of 10.00 and 20.00 on two scenes, and what is printed as their average."""
    scenes = {"East": {"R@1": "10.00"}, "West": {"R@1": "20.00"}}
    values = {f"M{i}": scenes | {"Average": {"R@1": text}} for i, text in enumerate(averages)}
    return audited(folder, rows_of(values))


def test_the_headline_says_that_averages_may_be_wrong(tmp_path: Path) -> None:
    found = audit_of_averages(tmp_path, "18.00", "12.00")
    told = "2 averages could not be checked against the scenes"
    assert told in found.summary
    assert "Nothing found in what could be checked." in audit_text(found, 100)
    right = audit_of_averages(tmp_path, "15.00", "15.00")
    assert "could not" not in right.summary
    assert "Nothing found.\n" in audit_text(right, 100)


def test_a_finding_was_checked(tmp_path: Path) -> None:
    found = audit_of_averages(tmp_path, "38.00", "18.00")
    [outcome] = [one for one in found.outcomes if one.check == "average"]
    assert outcome.text.startswith("1 averages against the scenes they are of: 1 found; not")
    assert "1 average could not be checked" in found.summary
    [outcome] = [
        one for one in audit_of_averages(tmp_path, "38.00").outcomes if one.check == "average"
    ]
    assert outcome.text == "1 averages against the scenes they are of: 1 found"


@pytest.mark.parametrize("changed", ["average", "AVERAGE"])
def test_names_that_differ_by_case_are_one(changed: str, tmp_path: Path) -> None:
    values = {"East": {"R@1": "10.00"}, "Average": {"R@1": "15.00"}, changed: {"R@1": "18.00"}}
    with pytest.raises(ResultError, match="once in a table"):
        published(tmp_path, rows_of({"A": values}))
    with pytest.raises(ResultError, match="once in a table"):
        published(tmp_path, rows_of({"A": {"East": {"R@1": "10.00", "r@1": "18.00"}}}))


@pytest.mark.parametrize("name", ["R@0", "R@-1", "R@5.5", "F1@0", "AUC@0", "P@0", "R@ -5"])
def test_what_is_no_score_is_left_out_by_name(name: str, tmp_path: Path) -> None:
    found = audited(tmp_path, rows_of({"A": {"East": {name: "10.00", "R@1": "20.00"}}}))
    assert not found.findings
    assert any("not known" in note and name in note for note in found.notes)


@pytest.mark.parametrize("name", ["R@5.5m", "R@0.5m, 2deg", "R@10", "R@1%"])
def test_what_is_a_score_is_known(name: str, tmp_path: Path) -> None:
    found = audited(tmp_path, rows_of({"A": {"East": {name: "10.00", "R@1": "20.00"}}}))
    assert not any("not known" in note for note in found.notes)
