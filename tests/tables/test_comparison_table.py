"""Comparisons as tables: their order, and notes that do not repeat themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from airzoo_bench.results.comparison import compare
from airzoo_bench.results.selection import choose_scores
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.comparison_layout import comparison_table
from airzoo_bench.tables.model import Between
from airzoo_bench.tables.wording import notes_by_reason
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT, made_method, random_methods
from tests.tables.comparisons import FAST, PAIR, against


class TestTable:
    def test_the_best_of_a_score_comes_first(self) -> None:
        methods = random_methods(4, {"east": 60, "west": 40}, (HIT, ERROR))
        table = comparison_table(against(methods[1], methods[3], methods[0], methods[2]))
        for part, sign in ((table.rows[:3], -1), (table.rows[3:], 1)):
            values = [sign * float(row.cells[3].value or 0) for row in part]
            assert values == sorted(values)
        assert table.texts()[0][1] == "method03"

    def test_an_interval_stands_beside_its_difference(self) -> None:
        comparison = against(*random_methods(2, {"east": 60}, (HIT,)))
        pair = comparison.pairs[0]
        assert pair.interval.low is not None
        assert pair.interval.high is not None
        cell = comparison_table(comparison).rows[0].cells[5]
        assert cell.value == pytest.approx(100 * (pair.value - pair.reference_value))
        limits = Between(100 * pair.interval.low, 100 * pair.interval.high)
        assert cell.uncertainty == limits
        assert [c.text(4) for c in comparison_table(comparison).rows[0].cells[6:8]] == [
            f"{pair.test.p_value:.4f}"
        ] * 2

    def test_scores_with_one_finding_are_one_line(self) -> None:
        methods = random_methods(9, {"east": 300, "west": 300}, (HIT, SOFT))
        notes = comparison_table(against(*methods, every=True)).notes
        lines = [note for note in notes if "against method00" in note]
        said = {note.split(": ")[1] for note in lines}
        assert len(said) == len(lines) <= 2
        assert "and 2 more better" in lines[0]

    def test_many_scores_of_two_are_summed_up(self) -> None:
        columns = [
            HIT.model_copy(update={"key": f"recall@{k}", "title": f"R@{k}"}) for k in range(5)
        ]
        random = np.random.default_rng(0)
        scenes = [
            {"s": {c.key: (random.random(200) < rate).astype(float).tolist() for c in columns}}
            for rate in (0.3, 0.7)
        ]
        methods = [made_method(s, columns, n) for s, n in zip(scenes, "ab", strict=True)]
        notes = comparison_table(against(*methods)).notes
        assert notes[0] == "b against a: better on R@0, R@1, R@2, R@3, R@4"
        assert not any(" by " in note for note in notes[:-2])

    def test_too_few_scenes_are_told_once(self) -> None:
        scores = (CHAMFER, CHAMFER.model_copy(update={"key": "accuracy_m", "title": "Accuracy"}))
        methods = [
            made_method({s: {"chamfer_m": [v], "accuracy_m": [v]} for s in "xy"}, scores, n)
            for n, v in (("a", 1.0), ("b", 2.0))
        ]
        table = comparison_table(against(*methods))
        assert table.title == "Against a, 2 scenes"
        assert [row[2] for row in table.texts()] == ["too few"] * 2
        assert table.notes[:2] == (
            "all scores: too few to tell; only 2 scenes differ, so p cannot be below 0.5",
            "all scores: no interval; only 2 scenes: an interval needs 5",
        )
        assert len(table.notes) == 3

    def test_disagreements_are_told_once(self) -> None:
        found = against(*random_methods(3, {"east": 60}, (HIT,)))
        doubtful = Interval(-0.5, 0.5, "bca")
        sure = replace(PAIR.test, p_value=0.001)
        pairs = [
            replace(pair, interval=doubtful, test=sure, p_holm=0.002, wins=30)
            for pair in found.pairs
        ]
        notes = comparison_table(replace(found, pairs=pairs)).notes
        assert notes[1] == "R@1: better, but the interval holds 0"
        pairs[0] = replace(pairs[0], interval=Interval(0.1, 0.2, "bca"), p_holm=0.3)
        notes = comparison_table(replace(found, pairs=pairs)).notes
        assert notes[1:3] == (
            "R@1 of method02: better, but the interval holds 0",
            "R@1 of method01: unclear, but the interval excludes 0, as p does before Holm's "
            "correction: intervals are not corrected for the number of methods",
        )
        alone = replace(found, pairs=pairs[1:])
        assert sum("holds 0" in note for note in comparison_table(alone).notes) == 1

    def test_what_p_is_corrected_for(self) -> None:
        methods = random_methods(3, {"east": 60}, (HIT,))
        scores = choose_scores(methods, [])
        named, best = (
            comparison_table(compare(methods, scores, reference=name, resampling=FAST)).notes[-1]
            for name in (None, "best")
        )
        assert "; corrected by Holm for the number of methods, not of scores; McNemar" in named
        assert (
            "; corrected by Holm for all 3 pairs of methods, since the reference was chosen" in best
        )
        two = compare(methods[:2], scores, reference="best", resampling=FAST)
        assert "pairs of methods" not in comparison_table(two).notes[-1]

    def test_random_patterns_that_are_too_few_for_holm(self) -> None:
        methods = random_methods(7, {"east": 60}, (HIT,))
        scores = choose_scores(methods, [])
        for resamples, told in ((118, True), (119, False)):
            resampling = ResamplingConfig(resamples=resamples)
            notes = comparison_table(compare(methods, scores, resampling=resampling)).notes
            assert ("cannot be below" in notes[-1]) == told
        # By the count of every pattern, there is no such limit.
        alike = [made_method({"s": {"recall@1": [1.0] * 6}}, name=n) for n in "abcdefg"]
        notes = comparison_table(
            compare(alike, scores, resampling=ResamplingConfig(resamples=100))
        ).notes
        assert not any("cannot be below" in note for note in notes if "Holm" in note)

    def test_one_scene(self) -> None:
        methods = [
            made_method({"x": {"chamfer_m": [v]}}, (CHAMFER,), n)
            for n, v in zip("ab", (1.0, 2.0), strict=True)
        ]
        table = comparison_table(against(*methods))
        assert table.title == "Against a, 1 scene"
        assert "only 1 scene differs, so p is 1" in table.notes[0]


class TestReasons:
    def test_they_are_collapsed(self) -> None:
        entries = [
            ("few" if score is HIT or scene == "b" else "", score, scene)
            for scene in "abc"
            for score in (HIT, SOFT, ERROR)
        ]
        assert notes_by_reason(entries) == ["R@1; MRR, Median in b: few"]
        assert notes_by_reason([("few", s, m) for _, s, m in entries]) == ["all scores: few"]

    def test_many_are_counted(self) -> None:
        scores = [HIT.model_copy(update={"title": f"R@{k}"}) for k in range(9)]
        entries = [
            ("few" if m < 5 and s is not scores[0] else "", s, str(m))
            for m in range(9)
            for s in scores
        ]
        assert notes_by_reason(entries, "no; ", "of") == [
            "R@1, R@2, R@3, R@4, R@5, R@6 and 2 more of 0, 1, 2 and 2 more: no; few"
        ]

    def test_one_score_is_named(self) -> None:
        assert notes_by_reason([("few", HIT, "a")]) == ["R@1: few"]
