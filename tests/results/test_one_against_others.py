"""One method against each other, as a comparison and as a table."""

from __future__ import annotations

from dataclasses import replace

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.results.comparable import choose_scores
from airzoo_bench.results.comparison import compare
from airzoo_bench.tables.comparison import comparison_table, verdict
from tests.statistics.support import ERROR, HIT, random_methods
from tests.tables.comparisons import FAST


class TestOfOne:
    """One method against each other: everything from its own side."""

    def test_it_is_the_mirror_of_the_others(self) -> None:
        methods = random_methods(4, {"east": 60, "west": 40}, (HIT, ERROR))
        scores = choose_scores(methods, [])
        theirs = compare(methods, scores, reference="method03", resampling=FAST).pairs
        found = compare(methods, scores, method="method03", resampling=FAST)
        assert (found.reference, found.family, found.of_one) == ("method03", 3, True)
        mirrored = {"better": "worse", "worse": "better"}
        for mine, other in zip(found.pairs, theirs, strict=True):
            assert (mine.method, mine.reference) == ("method03", other.method)
            assert found.other(mine) == other.method
            assert (mine.value, mine.reference_value) == (other.reference_value, other.value)
            assert (mine.wins, mine.ties, mine.losses) == (other.losses, other.ties, other.wins)
            assert mine.difference == pytest.approx(-(other.difference or 0.0))
            assert (mine.test, mine.p_holm, mine.p_mcnemar) == (
                other.test,
                other.p_holm,
                other.p_mcnemar,
            )
            limits = (mine.interval.low, mine.interval.high, -other.interval.high)  # type: ignore[operator]
            assert limits[0] == pytest.approx(limits[2])
            assert verdict(mine) == mirrored.get(verdict(other), verdict(other))

    def test_table(self) -> None:
        methods = random_methods(4, {"east": 60, "west": 40}, (HIT, ERROR))
        scores = choose_scores(methods, [])
        table = comparison_table(compare(methods, scores, method="method03", resampling=FAST))
        assert table.title == "method03 against each other method, all scenes, 100 queries"
        heads = [column.title for column in table.columns]
        assert heads[:6] == ["Score", "Against", "Verdict", "Value", "Other", "Difference"]
        # Of each score the hardest rival stands first; its numbers are in the column of the others.
        rivals = [(row[0], float(row[4])) for row in table.texts()]
        for score, sign in (("R@1 [%]", -1), ("Median [m]", 1)):
            values = [sign * value for title, value in rivals if title == score]
            assert values == sorted(values)
            assert len(values) == 3
        assert len({row[3] for row in table.texts()}) == len(scores)

    def test_what_p_is_corrected_for(self) -> None:
        methods = random_methods(4, {"east": 60}, (HIT,))
        scores = choose_scores(methods, [])
        best = compare(methods, scores, method="best", resampling=FAST)
        assert best.family == 6
        assert (
            "corrected by Holm for all 6 pairs of methods, since the method was chosen"
            in (comparison_table(best).notes[-1])
        )

    @pytest.mark.parametrize("option", ["method", "reference"])
    def test_names_by_part(self, option: str) -> None:
        methods = random_methods(2, {"east": 60}, (HIT,))
        methods[1] = replace(methods[1], name="MegaLoc (Ours)")
        for wanted in ("ours", "MegaLok (Ours)"):
            with pytest.raises(UsageError) as error:
                compare(methods, [HIT], resampling=FAST, **{option: wanted})
            assert f"--{option} '{wanted}' is no method of these results" in error.value.what
            assert error.value.what.endswith("(did you mean 'MegaLoc (Ours)'?)")
        with pytest.raises(UsageError, match="exclude each other"):
            compare(methods, [HIT], resampling=FAST, method="method00", reference="method00")
