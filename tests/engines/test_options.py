"""What the command line says and does with `--resume` and `--progress`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.cli.engines import watched
from airzoo_bench.core.errors import UserError
from airzoo_bench.engines.engine import Here
from airzoo_bench.engines.kept import kept_folder
from tests.engines.work import named
from tests.support import run_main, write_predictions


def squared(worst: int, number: int) -> dict[str, Any]:
    if number == worst:
        raise UserError("stopped")
    return {"square": np.array(number * number)}


def run(out: Path, worst: int = -1, *, stop_at: int | None = None, **options: bool) -> list[int]:
    asked = {"show_progress": False} | options
    with watched(Here(), keep_for=out, **asked) as engine:
        engine.begin("run")
        squares = []
        for one in engine.map(squared, range(5), shared=worst, stage="numbers", name=named):
            if len(squares) == stop_at:
                raise KeyboardInterrupt
            squares.append(int(one["square"]))
        return squares


def test_what_a_stopped_run_finished_is_used_and_then_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(UserError):
        run(out, worst=3, resume=True)
    assert kept_folder(out).is_dir()
    capsys.readouterr()
    assert run(out, worst=2, resume=True) == [0, 1, 4, 9, 16]  # task 2 is not done again
    assert "out.unfinished holds 3 finished tasks, which are used" in capsys.readouterr().err
    assert not kept_folder(out).exists()


def test_a_run_that_is_stopped_says_how_it_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run(out, resume=True, stop_at=2)
    told = capsys.readouterr().err
    assert "no task of an earlier run is kept" in told
    where = kept_folder(out)
    assert f"finished tasks kept in {where}; the same command with --resume goes on" in told


def test_what_is_left_is_told_and_not_used_without_resume(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(UserError):
        run(out, worst=3, resume=True)
    capsys.readouterr()
    with pytest.raises(UserError):
        run(out, worst=2)
    told = capsys.readouterr().err
    assert "holds 3 finished tasks of a run that was stopped; with --resume" in told
    assert kept_folder(out).is_dir()
    assert run(out) == [0, 1, 4, 9, 16]
    assert not kept_folder(out).exists()


def test_a_run_here_keeps_nothing_unless_asked(tmp_path: Path) -> None:
    with pytest.raises(UserError):
        run(tmp_path / "out", worst=3)
    assert list(tmp_path.iterdir()) == []


def test_resume_needs_a_folder(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    predictions = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", predictions, "--resume") == 2
    assert "--resume needs a folder to write into" in capsys.readouterr().err
