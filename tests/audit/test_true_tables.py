"""Tables that are right have no findings, whatever their numbers and however they were rounded."""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, ROUND_HALF_UP, Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import Audit
from tests.audit.support import Rows, published, rows_of, told

AT = (1, 3, 5)
SCENES = {"North": 97, "East": 161, "South": 190}
METHODS = ("Base", "Other", "Base (Ours)")


class Maker:
    """Makes rankings and prints their table, as an honest paper would."""

    def __init__(self, seed: int, rounding: str, decimals: int = 2) -> None:
        self.random = np.random.default_rng(seed)
        self.rounding, self.decimals = rounding, decimals

    def printed(self, value: Fraction) -> str:
        exact = Decimal(value.numerator) / Decimal(value.denominator)
        return f"{exact.quantize(Decimal(1).scaleb(-self.decimals), self.rounding):f}"

    def scores(self, queries: int) -> dict[str, Fraction]:
        hits = self.random.random((queries, 5)) < self.random.uniform(0.05, 0.5)
        errors = np.round(self.random.exponential(8, queries), 6)
        shares = {f"R@{k}": hits[:, :k].any(1).sum() for k in AT}
        shares |= {f"recall@{d}m": (errors < d).sum() for d in (5, 10, 20)}
        scores = {name: Fraction(100 * int(n), queries) for name, n in shares.items()}
        scores["AP@5"] = Fraction(100 * int(hits.sum()), 5 * queries)
        scores["median error"] = Fraction(float(np.median(errors))).limit_denominator(10**7)
        return scores

    def rows(self, weights: dict[str, int]) -> Rows:
        exact = {
            method: {scene: self.scores(n) for scene, n in SCENES.items()} for method in METHODS
        }
        total = sum(weights.values())
        for scenes in exact.values():
            names = next(iter(scenes.values()))
            scenes["Average"] = {
                name: sum((scenes[s][name] * w for s, w in weights.items()), Fraction(0)) / total
                for name in names
            }
        return [row for method in METHODS for row in self.method_rows(exact, method)]

    def method_rows(self, exact: dict[str, dict[str, dict[str, Fraction]]], method: str) -> Rows:
        rows = []
        for scene, scores in exact[method].items():
            for name, value in scores.items():
                column = [Decimal(self.printed(exact[m][scene][name])) for m in METHODS]
                best = min(column) if name == "median error" else max(column)
                (row,) = rows_of({method: {scene: {name: self.printed(value)}}})
                row["bold"] = int(Decimal(str(row["value"])) == best)
                row["unit"] = "m" if name == "median error" else "%"
                row["gain"] = ""
                if method == METHODS[-1]:
                    row["gain"] = self.printed(value - exact[METHODS[0]][scene][name])
                rows.append(row)
        return rows


def grave(found: Audit) -> list[tuple[str, str, str, str]]:
    return [finding for finding in told(found) if finding[0] != "rounding"]


@pytest.mark.parametrize("rounding", [ROUND_HALF_UP, ROUND_HALF_EVEN])
@pytest.mark.parametrize("seed", range(6))
def test_averages_over_scenes(tmp_path: Path, seed: int, rounding: str) -> None:
    rows = Maker(seed, rounding).rows(dict.fromkeys(SCENES, 1))
    table = published(tmp_path, rows)
    for counts in (SCENES, {}):
        found = audit(table, counts, "precision" if counts else None)
        assert not grave(found)
        # What is off by the last digit is a gain of exact values, never an average.
        assert {finding[1] for finding in told(found)} <= {"gain"}


@pytest.mark.parametrize("seed", range(3))
def test_averages_over_queries(tmp_path: Path, seed: int) -> None:
    rows = [
        row
        for row in Maker(seed, ROUND_HALF_UP).rows(SCENES)
        if row["metric"] != "median error"  # which is not averaged over queries
    ]
    found = audit(published(tmp_path, rows), SCENES, "precision")
    assert not grave(found)
    (text,) = (c.text for c in found.conclusions if c.check == "average")
    assert "21 of 21 are means over all queries" in text


@pytest.mark.parametrize("decimals", [0, 1, 4])
def test_other_digits(tmp_path: Path, decimals: int) -> None:
    rows = Maker(1, ROUND_HALF_UP, decimals).rows(dict.fromkeys(SCENES, 1))
    found = audit(published(tmp_path, rows), SCENES, "precision")
    assert not grave(found)


@pytest.mark.parametrize("seed", range(5))
def test_one_changed_digit_is_seen(tmp_path: Path, seed: int) -> None:
    rows = Maker(seed, ROUND_HALF_UP).rows(dict.fromkeys(SCENES, 1))
    at = [i for i, row in enumerate(rows) if row["scene"] in SCENES and row["metric"] == "R@3"]
    row = rows[np.random.default_rng(seed).choice(at)]
    row["value"] = f"{float(str(row['value'])) + 0.1:.2f}"
    found = audit(published(tmp_path, rows), SCENES, "precision")
    assert ("impossible", "counts", row["method"], "R@3") in told(found)
