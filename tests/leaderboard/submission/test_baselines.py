"""Predictions of the suite's own baselines are made again, compared and timed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.leaderboard import baselines
from airzoo_bench.leaderboard.baselines import remake
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.rescoring import rescore
from tests.leaderboard.submission.support import submission, write, write_board

SETTINGS = {"words": 2, "double": False}


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
    for content, same in ((b"made", True), (b"male", False)):
        file.write_bytes(content)
        found = remake(stated, "retrieval", file, data=tmp_path, resources=Resources())
        assert found.same_bytes is same
        assert found.seconds > 0
    assert (asked["track"], asked["protocol"]) == ("retrieval", "made-retrieval")
    settings = asked["settings"]
    assert (settings.words, settings.doubled, settings.seed) == (2, False, 0)


def test_what_came_of_it_is_said(
    tmp_path: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = write_board(tmp_path / "board")
    home = write(tmp_path / "board", perfect, baseline=SETTINGS)

    def run(track: str, protocol: str, out: Path, **_: Any) -> None:
        out.write_bytes((home / "preds.npz").read_bytes())

    monkeypatch.setattr(baselines, "run_baseline", run)
    checked = check_submission(home, board, data)
    found = rescore(checked, data=data, resources=Resources(), make_again=True)
    assert found.remade is not None
    assert found.remade.same_bytes
    assert "the same to the last byte" in found.lines[-1]
    assert "s a query" in found.lines[-1]
    assert rescore(checked, data=data, resources=Resources()).remade is None
