"""Each check on tables made to fail it, and on ones made to pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError, UsageError
from tests.audit.support import Rows, audited, only, row, rows_of, told


class TestRange:
    @pytest.mark.parametrize("value", ["100.01", "-0.01"])
    def test_no_share(self, tmp_path: Path, value: str) -> None:
        found = audited(tmp_path, row(R_1=value))
        assert told(found, "range") == [("impossible", "range", "A", "R@1")]

    def test_no_distance_is_negative(self, tmp_path: Path) -> None:
        made = rows_of({"A": {"East": {"Chamfer": "-0.1", "R@1": "5.0"}}})
        assert told(audited(tmp_path, made)) == [("impossible", "range", "A", "Chamfer")]


class TestOrder:
    def test_recall_grows(self, tmp_path: Path) -> None:
        found = audited(tmp_path, row(R_1="10.0", R_3="9.9", R_5="12.0"))
        assert told(found, "order") == [("impossible", "order", "A", "R@1")]
        assert "R@1 = 10.0 > R@3 = 9.9" in only(found, "order").why

    def test_fewer_digits_are_no_contradiction(self, tmp_path: Path) -> None:
        assert not told(audited(tmp_path, row(R_1="10.04", R_3="10")), "order")
        assert not told(audited(tmp_path, row(R_1="10.04", R_3="10.0")), "order")
        assert told(audited(tmp_path, row(R_1="10.51", R_3="10")), "order")

    def test_pairs_of_thresholds(self, tmp_path: Path) -> None:
        scores = {"recall@(5m,1deg)": "50.0", "recall@(10m,1deg)": "49.0"}
        found = audited(tmp_path, rows_of({"A": {"East": scores}}))
        assert told(found, "order") == [("impossible", "order", "A", "recall@(5m,1deg)")]


class TestCounts:
    def test_given(self, tmp_path: Path) -> None:
        found = audited(tmp_path, row(R_1="96.21", R_5="96.23"), East=264)
        assert told(found, "counts") == [("impossible", "counts", "A", "R@5")]
        assert only(found, "counts").why.startswith(
            "96.23 % of 264 queries is 254.05 queries, no whole number: 254/264 = 96.21, 255/264"
        )

    @pytest.mark.parametrize("printed", ["3.78", "96.22"])
    def test_what_a_way_of_rounding_explains(self, tmp_path: Path, printed: str) -> None:
        found = audited(tmp_path, row(R_1=printed, R_5="96.97", R_10="99.24"), East=264)
        assert told(found) == [("rounding", "counts", "A", "R@1")]

    def test_two_numbers_for_one_scene(self, tmp_path: Path) -> None:
        made = [{**r, "n": 264} for r in row(R_1="96.22")]
        with pytest.raises(ResultError, match=r"264 \(line 2\), 265 \(--counts\)"):
            audited(tmp_path, made, East=265)

    def test_unknown_scene(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="did you mean 'East'"):
            audited(tmp_path, row(R_1="96.22"), Eas=265)

    def test_an_average_over_scenes_is_no_count(self, tmp_path: Path) -> None:
        values = {"City": {"R@1": "50.00"}, "Rural": {"R@1": "25.00"}, "Average": {"R@1": "37.50"}}
        found = audited(tmp_path, rows_of({"A": values}), City=4, Rural=4, Average=3)
        assert not found.findings


class TestAverage:
    def made(self, average: str, scores: tuple[str, ...] = ("10.00", "20.00", "40.00")) -> Rows:
        scenes = {f"S{i}": {"R@1": value} for i, value in enumerate(scores)}
        return rows_of({"A": scenes | {"Average": {"R@1": average}}})

    def test_over_scenes(self, tmp_path: Path) -> None:
        assert not audited(tmp_path, self.made("23.33")).findings

    def test_over_queries(self, tmp_path: Path) -> None:
        # 1/10, 4/20, 28/70: 33 of 100.
        found = audited(tmp_path, self.made("33.00"), S0=10, S1=20, S2=70)
        assert not found.findings
        texts = [c for c in found.conclusions if c.startswith("average of")]
        assert "1 of 1 is a mean over all queries" in texts[0]

    def test_neither(self, tmp_path: Path) -> None:
        found = audited(tmp_path, self.made("24.00"), S0=10, S1=10, S2=10)
        assert told(found) == [("inconsistent", "average", "A", "R@1")]
        why = found.findings[0].why
        assert (
            why == "the mean of 3 scenes is 23.3333, which rounds to 23.33; printed here is 24.00"
        )

    def test_over_queries_of_unknown_numbers(self, tmp_path: Path) -> None:
        # 24.00 may be over all queries; 41.00 is more than any scene has.
        assert not audited(tmp_path, self.made("24.00")).findings
        found = audited(tmp_path, self.made("41.00"))
        assert told(found) == [("inconsistent", "average", "A", "R@1")]
        assert "whose values lie between 9.9950 and 40.0050" in found.findings[0].why

    def test_a_median_of_all_queries_is_no_mean_of_medians(self, tmp_path: Path) -> None:
        scenes = {f"S{i}": {"median error": value} for i, value in enumerate(("2.0", "4.0"))}
        for average, wrong in (("2.2", False), ("3.0", False), ("4.2", True)):
            made = rows_of({"A": scenes | {"Average": {"median error": average}}})
            assert bool(told(audited(tmp_path, made))) is wrong

    def test_of_rounded_values(self, tmp_path: Path) -> None:
        # 34/161 and 8/190 have the mean 12.664; as printed 21.12 and 4.21 they have 12.665.
        found = audited(tmp_path, self.made("12.67", ("21.12", "4.21")), S0=161, S1=190)
        assert told(found) == [("rounding", "average", "A", "R@1")]
        assert "values as printed have the mean 12.6650" in found.findings[0].why
        assert not audited(tmp_path, self.made("12.66", ("21.12", "4.21")), S0=161, S1=190).findings


class TestGain:
    def made(self, gain: str, value: str = "28.64", metric: str = "R@1") -> Rows:
        return rows_of(
            {"C": {"East": {metric: "1.00"}}, "X": {"East": {metric: "26.91"}}}
        ) + rows_of({"X (Ours)": {"East": {metric: value}}}, gain=gain)

    @pytest.mark.parametrize(
        ("gain", "grade"),
        [("+1.73", None), ("1.73", None), ("+1.74", "rounding"), ("+1.75", "inconsistent")],
    )
    def test_gains(self, tmp_path: Path, gain: str, grade: str | None) -> None:
        found = told(audited(tmp_path, self.made(gain)), "gain")
        assert found == ([(grade, "gain", "X (Ours)", "R@1")] if grade else [])

    @pytest.mark.parametrize("gain", ["-1.73", "+1.73"])
    def test_an_error_may_go_down_as_a_gain(self, tmp_path: Path, gain: str) -> None:
        assert not told(audited(tmp_path, self.made(gain, "25.18", "median error")), "gain")

    def test_gains_over_the_best_of_the_others(self, tmp_path: Path) -> None:
        values = {"A": ("10.0", "30.0", "20.0"), "B": ("20.0", "10.0", "40.0")}
        scores = ("R@1", "R@3", "F1")
        rows = rows_of({m: {"East": dict(zip(scores, v, strict=True))} for m, v in values.items()})
        for gains, wrong in ((("+5.0", "+1.0", "+2.0"), 0), (("+5.0", "+1.0", "+3.0"), 1)):
            own = [
                row
                for score, gain, value in zip(scores, gains, ("25.0", "31.0", "42.0"), strict=True)
                for row in rows_of({"Y": {"East": {score: value}}}, gain=gain)
            ]
            found = audited(tmp_path, rows + own)
            assert len(told(found, "gain")) == wrong
            (text,) = (c for c in found.conclusions if c.startswith("gain"))
            assert "gains are over the best of the others:" in text


class TestBold:
    def made(self, *values: tuple[str, int], metric: str = "R@1") -> Rows:
        return [
            {**r, "bold": bold}
            for i, (value, bold) in enumerate(values)
            for r in rows_of({f"M{i}": {"East": {metric: value}}})
        ]

    @pytest.mark.parametrize("bold", [0, 1])
    def test_all_of_the_best_or_none(self, tmp_path: Path, bold: int) -> None:
        made = self.made(("10.0", 0), ("20.0", bold), ("20.0", bold))
        assert not told(audited(tmp_path, made), "bold")

    def test_not_the_best(self, tmp_path: Path) -> None:
        found = audited(tmp_path, self.made(("10.0", 1), ("20.0", 1)))
        assert told(found, "bold") == [("inconsistent", "bold", "M0", "R@1")]

    def test_a_tie_half_bold(self, tmp_path: Path) -> None:
        found = audited(tmp_path, self.made(("20.0", 1), ("20.0", 0)))
        assert told(found, "bold") == [("rounding", "bold", "M1", "R@1")]
