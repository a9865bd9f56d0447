"""Verdicts of comparisons, and hits in their words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from airzoo_bench.matching.metrics import matching_scores
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.track import reconstruction_scores
from airzoo_bench.results.comparison import is_hit
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.retrieval.scoring import list_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.tables.comparison import comparison_table, sentence, verdict
from airzoo_bench.tables.render import render
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT, made_method
from tests.tables.comparisons import FAST, PAIR, against


def scores_of(name: str) -> tuple[str, tuple[ScoreColumn, ...]]:
    protocol = load_protocol(shipped_protocols()[name])
    if isinstance(protocol, RetrievalProtocol):
        return "retrieval", score_columns(list_scores(protocol.scores))
    if isinstance(protocol, MatchingProtocol):
        return "matching", score_columns(matching_scores(protocol.scores))
    assert isinstance(protocol, ReconstructionProtocol)
    return "reconstruction", score_columns(reconstruction_scores(protocol.scores))


class TestHits:
    def test_every_shipped_protocol(self) -> None:
        tracks = set()
        for name in shipped_protocols():
            track, scores = scores_of(name)
            tracks.add(track)
            hits = {score.title for score in scores if is_hit(track, score)}
            # A reconstruction's R@10m is a share of points, though it may be 1.
            known = {"retrieval": ("R@", "D<", "MA@"), "matching": ("@",), "reconstruction": ()}[
                track
            ]
            assert hits == {score.title for score in scores if score.title.startswith(known)}
        assert tracks == {"retrieval", "matching", "reconstruction"}

    def test_values_say_nothing(self) -> None:
        scenes = {"s": {"recall@1": [1.0] * 6, "mrr": [1.0, 0, 1, 0, 1, 0]}}
        pairs = against(*(made_method(scenes, (HIT, SOFT), n) for n in "ab"), every=True).pairs
        assert [pair.p_mcnemar for pair in pairs] == [1.0, None]

    def test_scenes_are_no_hits(self) -> None:
        precision = ScoreColumn(
            key="precision_10m",
            title="P@10m",
            unit="share",
            higher_is_better=True,
            average="mean",
            headline=True,
        )
        methods = [
            made_method(
                {s: {"chamfer_m": [1.0], "precision_10m": [v]} for s in "abc"},
                (CHAMFER, precision),
                n,
            )
            for n, v in (("one", 1.0), ("two", 0.0))
        ]
        assert [pair.p_mcnemar for pair in against(*methods).pairs] == [None, None]


class TestVerdict:
    @pytest.mark.parametrize(
        ("changes", "word"),
        [
            ({}, "better"),
            ({"difference": -0.1}, "worse"),
            ({"score": ERROR}, "worse"),
            ({"score": ERROR, "difference": -0.1}, "better"),
            ({"p_holm": 0.05}, "better"),
            ({"p_holm": 0.0501}, "unclear"),
            ({"difference": 0.0}, "unclear"),
            ({"difference": None}, "unclear"),
            ({"difference": 0.0, "wins": 1, "losses": 1}, "too few"),
            ({"difference": None, "wins": 1, "losses": 1}, "too few"),
            ({"difference": 0.0, "wins": 0, "losses": 0}, "equal"),
            ({"difference": 1e-10, "wins": 0, "losses": 0}, "equal"),
            ({"wins": 5, "losses": 0}, "too few"),
            ({"wins": 3, "losses": 3}, "better"),
            ({"difference": np.inf}, "better"),
        ],
    )
    def test_words(self, changes: dict[str, object], word: str) -> None:
        assert verdict(replace(PAIR, **changes)) == word  # type: ignore[arg-type]

    @pytest.mark.parametrize("form", ["terminal", "csv", "json", "markdown", "html", "latex"])
    def test_is_the_same_everywhere(self, form: str) -> None:
        # The same average, and one query for each: no test can find anything.
        rows = {"a": [1.0, 0.0] * 10, "b": [0.0, 1.0] + [1.0, 0.0] * 9}
        methods = [made_method({"s": {"recall@1": row}}, (HIT,), n) for n, row in rows.items()]
        table = comparison_table(against(*methods))
        assert (table.rows[0].cells[2].value, table.rows[0].cells[5].value) == ("too few", 0.0)
        said = render(table, form) + "\n".join(table.notes)
        assert "too few" in said
        assert "equal" not in said
        [pair] = against(*methods).pairs
        assert sentence(pair, FAST).startswith("Too few to tell b and a apart")

    def test_a_small_p_is_never_nothing(self) -> None:
        tiny = replace(PAIR, test=replace(PAIR.test, p_value=9.9e-5), p_mcnemar=1e-9)
        assert "p < 0.0001, after Holm = 0.0200, McNemar < 0.0001" in sentence(tiny, FAST)
