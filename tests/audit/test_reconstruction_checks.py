"""F1 on tables made to fail its check, and on ones made to pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.audit.support import Rows, audited, rows_of, told


class TestF1:
    def made(self, scene: str = "East", **scores: str) -> Rows:
        return rows_of({"A": {scene: scores}})

    def test_possible(self, tmp_path: Path) -> None:
        found = audited(tmp_path, self.made(Precision="80.00", Recall="60.00", F1="68.57"))
        assert not found.findings

    def test_impossible(self, tmp_path: Path) -> None:
        found = audited(tmp_path, self.made(Precision="80.00", Recall="60.00", F1="70.00"))
        assert told(found) == [("impossible", "F1", "A", "F1")]
        why = "F1 = 2 x 80.00 x 60.00 / (80.00 + 60.00) = 68.57, printed is 70.00"
        assert found.findings[0].why == why

    @pytest.mark.parametrize(
        ("f1", "outside"), [("68.57", False), ("45.00", False), ("68.60", True), ("39.00", True)]
    )
    def test_an_average_has_bounds_only(self, tmp_path: Path, f1: str, outside: bool) -> None:
        made = self.made("Average", Precision="80.00", Recall="60.00", F1=f1)
        assert bool(told(audited(tmp_path, made), "F1")) is outside
