"""Numbers that a paper prints twice, and rows that are those of another."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.audit.support import Rows, audited, row, rows_of, told


class TestAgreement:
    def made(self, *values: str) -> Rows:
        return [{**r, "table": f"T{i}"} for i, value in enumerate(values) for r in row(R_1=value)]

    @pytest.mark.parametrize(
        ("first", "second", "grade"),
        [("50.00", "50.01", "rounding"), ("50.00", "50.02", "inconsistent")],
    )
    def test_printed_twice(self, tmp_path: Path, first: str, second: str, grade: str) -> None:
        found = audited(tmp_path, self.made(first, second))
        assert told(found) == [(grade, "agreement", "A", "R@1")]
        assert f"printed {first} here and {second} in T1, line 3" in found.findings[0].why

    def test_what_averages_show_is_counted_and_not_said_again(self, tmp_path: Path) -> None:
        scenes = {"S0": {"R@1": "10.00"}, "S1": {"R@1": "20.00"}, "Average": {"R@1": "15.00"}}
        wrong = {"overall": {"R@1": "17.00"}}
        made = [{**r, "table": "T0"} for r in rows_of({"A": scenes})]
        made += [{**r, "table": "T1"} for r in rows_of({"A": wrong})]
        found = audited(tmp_path, made, S0=10, S1=10)
        assert told(found) == [("inconsistent", "average", "A", "R@1")]

    @pytest.mark.parametrize("fewer", [("96.21", "96.2"), ("50.00", "50.0")])
    def test_fewer_digits_say_the_same(self, tmp_path: Path, fewer: tuple[str, str]) -> None:
        assert not audited(tmp_path, self.made(*fewer)).findings
        assert audited(tmp_path, self.made("96.21", "96.1")).findings

    def test_a_row_under_another_name(self, tmp_path: Path) -> None:
        first = rows_of(
            {"A": {"overall": {"R@1": "10.0", "R@3": "20.0", "R@5": "30.0"}}}, table="T0"
        )
        other = rows_of(
            {
                "A": {"Average": {"R@1": "15.0", "R@3": "25.0", "R@5": "35.0"}},
                "B": {"Average": {"R@1": "10.0", "R@3": "20.0", "R@5": "30.0"}},
            },
            table="T1",
        )
        found = audited(tmp_path, first + other)
        assert ("inconsistent", "row", "A", "R@1") in told(found)
        whys = [f.why for f in found.findings if f.check == "row"]
        assert len(whys) == 1
        assert "are those of B in T1, Average" in whys[0]
