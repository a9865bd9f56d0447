"""What the check of a submission's folder refuses, and of what it warns."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard.checks import FETCHED, check_pipeline
from tests.leaderboard.submission.support import (
    checked,
    only_error,
    submission,
    write,
    write_board,
)
from tests.statistics.support import made_method


def test_a_sound_submission_has_no_fault(board: Path, data: Path, perfect: Any) -> None:
    found = checked(write(board, perfect), data)
    assert not found.errors
    assert not found.warnings
    assert found.protocol is not None
    assert found.protocol.name == "made-retrieval"
    assert found.predictions == found.folder / "preds.npz"


def test_predictions_are_held_to_the_benchmark(board: Path, data: Path, perfect: Any) -> None:
    perfect["ranked_ids"][0][1] = perfect["ranked_ids"][0][0]
    found = checked(write(board, perfect), data)
    assert "each tile once a query" in only_error(found)


class TestAddress:
    def given(self, home: Path) -> dict[str, Any]:
        file = home / "preds.npz"
        size, sha256 = file.stat().st_size, sha256_of_tree(file)
        return {"url": "https://example.org/preds.npz", "bytes": size, "sha256": sha256}

    def test_predictions_are_fetched_where_that_is_asked_and_kept(
        self, board: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        source = write(board, perfect, folder="source")
        home = write(board, perfect, method="Other", predictions=self.given(source))
        (home / "preds.npz").unlink()
        asked = []

        def fetch(url: str, into: Path, *, size: int, sha256: str, seconds: float) -> Path:
            asked.append((url, size, sha256))
            into.mkdir(parents=True)
            (into / ".preds.npz.part").touch()
            return Path(shutil.copy(source / "preds.npz", into))

        monkeypatch.setattr("airzoo_bench.leaderboard.checks.fetch", fetch)
        assert checked(home, data).predictions is None
        for seconds in (1.0, 0.0):
            found = checked(home, data, seconds)
            assert not found.errors
            assert found.predictions is not None
            assert found.predictions.is_relative_to(data / FETCHED)
        given = self.given(source)
        assert asked == [(given["url"], given["bytes"], given["sha256"])]

    def test_what_is_never_fetched_is_refused_before(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        given = self.given(write(board, perfect, folder="source"))
        given["url"] = "https://169.254.169.254/preds.npz"
        home = write(board, perfect, method="Other", predictions=given)
        (home / "preds.npz").unlink()
        assert "expected: https://HOST/PATH" in only_error(checked(home, data))

    def test_more_than_the_board_fetches(self, board: Path, data: Path, perfect: Any) -> None:
        write_board(board, "[limits]\nurl_bytes = 100\n")
        given = self.given(write(board, perfect, folder="source"))
        home = write(board, perfect, method="Other", predictions=given)
        (home / "preds.npz").unlink()
        assert "at most 100, the limit of this board" in only_error(checked(home, data))


class TestNames:
    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"method": "Salad", "team": "Other"}, "'Salad', which looks like 'SALAD'"),
            ({"method": "New", "team": "Example Iab"}, "which looks like 'Example Lab'"),
            ({}, "your team has a method 'SALAD' here already, in salad"),
            ({"method": "S-A-L-A-D"}, "a method 'SALAD' here already, in salad"),
        ],
    )
    def test_refused(
        self, board: Path, data: Path, perfect: Any, changes: dict[str, Any], said: str
    ) -> None:
        write(board, perfect)
        assert said in only_error(checked(write(board, perfect, "second", **changes), data))

    def test_supersedes_is_ignored_with_a_note(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        file = home / "submission.toml"
        file.write_text('supersedes = "nothing"\n' + file.read_text())
        found = checked(home, data)
        assert not found.errors
        assert "'supersedes'" in found.warnings[0]

    def test_predictions_of_somebody_else_are_said(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        write(board, perfect)
        copied = checked(write(board, perfect, "copy", method="Mine", team="Other"), data)
        assert not copied.errors
        assert copied.warnings == [
            "the predictions are to the last byte those of 'SALAD' of team 'Example Lab', in salad"
        ]

    def test_the_same_method_of_another_team_is_only_said(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        write(board, perfect)
        found = checked(write(board, perfect, "second", team="Other"), data)
        assert not found.errors
        assert "'SALAD' is on this board already, of team 'Example Lab', in salad" in found.warnings


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result = made_method({"east": {"recall@1": [1.0] * 10}}).result
    counts = {scene: c | {"near_prior": 2} for scene, c in result.counts.items()}
    result = result.model_copy(update={"counts": counts})
    assert "2 of 10 poses are the photo's own prior" in str(check_pipeline(submission(), result))
    uses = submission(pipeline={"stages": "single-stage", "uses": ["prior"]})
    assert check_pipeline(uses, result) is None
