"""Predictions of the suite's own baselines are made again, compared and timed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import baselines
from airzoo_bench.leaderboard.baselines import remake
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.rescoring import rescore
from tests.leaderboard.submission.support import submission, write, write_board
from tests.support import write_predictions

SETTINGS = {"long-side": 256, "double": False}


def test_it_is_made_with_the_stated_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, Any] = {}

    def run(track: str, protocol: str, out: Path, **options: Any) -> None:
        asked.update(track=track, protocol=protocol, **options)
        out.write_bytes(b"made")

    monkeypatch.setattr(baselines, "run_baseline", run)
    file = tmp_path / "preds.npz"
    stated = submission(baseline=SETTINGS)
    file.write_bytes(b"made")
    resources = Run()
    found = remake(stated, "retrieval", file, lambda _: False, data=tmp_path, run=resources)
    assert found.same_bytes
    assert found.alike
    assert found.seconds > 0
    assert (asked["track"], asked["protocol"]) == ("retrieval", "made-retrieval")
    settings = asked["settings"]
    assert (settings.long_side_px, settings.doubled) == (256, False)


def test_what_came_of_it_is_said(
    tmp_path: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = write_board(tmp_path / "board")
    home = write(tmp_path / "board", perfect, baseline=SETTINGS)

    def run(track: str, protocol: str, out: Path, **_: Any) -> None:
        out.write_bytes((home / "preds.npz").read_bytes())

    monkeypatch.setattr(baselines, "run_baseline", run)
    checked = check_submission(home, board, data)
    found = rescore(checked, data=data, run=Run(), make_again=True)
    assert found.remade is not None
    assert found.remade.same_bytes
    assert "the same to the last byte" in found.lines[-1]
    assert "s a query" in found.lines[-1]
    assert rescore(checked, data=data, run=Run()).remade is None


@pytest.mark.parametrize("alike", [True, False])
def test_time_of_another_method_is_not_taken_for_that_of_the_baseline(
    tmp_path: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch, alike: bool
) -> None:
    """Who says that the baseline made the predictions would have its time beside other scores."""
    board = write_board(tmp_path / "board")
    home = write(tmp_path / "board", perfect, baseline=SETTINGS)
    ranked = [row if alike else row[::-1] for row in perfect["ranked_ids"]]

    def run(track: str, protocol: str, out: Path, **_: Any) -> None:
        scores = [[float(n) for n in range(len(row), 0, -1)] for row in ranked]
        write_predictions(out, protocol, **(perfect | {"ranked_ids": ranked, "scores": scores}))

    monkeypatch.setattr(baselines, "run_baseline", run)
    checked = check_submission(home, board, data)
    found = rescore(checked, data=data, run=Run(), make_again=True)
    assert found.remade is not None
    assert not found.remade.same_bytes
    assert found.remade.alike is alike
    assert ("they score otherwise" in found.lines[-1]) is not alike
