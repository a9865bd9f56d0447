"""What the command line says and does with `--resume` and `--progress`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from airzoo_bench.cli.engines import watched
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.mini.export.frames import RenderCounts
from airzoo_bench.engines.engine import Engine, Here
from airzoo_bench.engines.kept import kept_folder
from airzoo_bench.engines.report import RunReport
from airzoo_bench.evaluation.parts import Resources
from tests.datasets.geometry_checks.analytic import orbit, write_depths, write_photos
from tests.datasets.published import image_trees
from tests.engines import work
from tests.engines.work import named
from tests.support import run_main, write_predictions


def here() -> Engine:
    engine = Here()
    engine.report = RunReport()
    return engine


def squared(worst: int, number: int) -> dict[str, Any]:
    if number == worst:
        raise UserError("stopped")
    return {"square": np.array(number * number)}


def run(out: Path, worst: int = -1, *, stop_at: int | None = None, **options: bool) -> list[int]:
    asked = {"show_progress": False} | options
    with watched(here(), keep_for=out, **asked) as engine:
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


def test_progress_reports_at_the_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path / "out", show_progress=True)
    told = capsys.readouterr().err
    assert "numbers: 5 done in " in told
    assert "ten times as large: " in told
    assert "assumed: ten times as many tasks" in told


def test_resume_needs_a_folder(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    predictions = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", predictions, "--resume") == 2
    assert "--resume needs a folder to write into" in capsys.readouterr().err


def test_the_report_is_a_file_beside_the_result_and_not_in_it(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    predictions = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    ask = ("eval", "retrieval", predictions, "--method", "m", "--out", tmp_path / "out")
    assert run_main(*ask) == 0
    plain = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert run_main(*ask, "--progress") == 0
    watched_run = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert watched_run.pop("run_report.json").startswith(b"{")
    assert watched_run == plain
    assert run_main(*ask) == 0  # a report of another run does not stay
    assert not (tmp_path / "out" / "run_report.json").exists()


def reported_stage(capsys: pytest.CaptureFixture[str], stage: str) -> None:
    told = capsys.readouterr().err
    assert re.search(rf"^{stage}: \d+ done in ", told, re.MULTILINE), told
    assert "ten times as large: " in told


def test_prepare_shows_and_reports_its_scenes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    source = image_trees.university_1652(tmp_path / "tree")
    ask = ("prepare", "university-1652", "--source", source, "--jobs", 1)
    assert run_main(*ask, "--out", tmp_path / "plain") == 0
    assert "done in" not in capsys.readouterr().err
    assert run_main(*ask, "--out", tmp_path / "shown", "--progress") == 0
    reported_stage(capsys, "scenes")


def test_check_geometry_reports_its_pairs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = orbit(10)
    write_depths(tmp_path / "depth", flight.depths())
    images, poses = write_photos(tmp_path, flight)
    asked = ("check-geometry", "--poses", poses, "--images", images, "--samples", 512)
    assert run_main(*asked, "--progress") == 0
    reported_stage(capsys, "pairs of frames")


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_baseline_reports_what_its_processes_did(
    jobs: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def predict(*_: object, resources: Resources, **__: object) -> None:
        found = resources.processes.map(work.square, range(4), shared=1, stage="photos", name=named)
        assert len(list(resources.progress(found, "photos", 4))) == 4

    monkeypatch.setattr("airzoo_bench.evaluation.generate.run_baseline", predict)
    asked = ("baseline", "matching", "any", "--jobs", jobs, "--out", "x.npz")
    assert run_main(*asked, "--progress") == 0
    reported_stage(capsys, "photos")
    assert run_main(*asked) == 0
    assert "done in" not in capsys.readouterr().err


def test_rendering_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def render(*_: object, engine: Engine, progress: Progress) -> RenderCounts:
        done = engine.map(work.square, range(4), shared=1, stage="rendering", name=named)
        return RenderCounts(rendered=len(list(progress(done, "rendering", 4))), kept=0)

    monkeypatch.setattr("airzoo_bench.cli.mini._folder", lambda *_: tmp_path)
    monkeypatch.setattr("airzoo_bench.cli.mini._world", mock.MagicMock())
    here = "airzoo_bench.datasets.mini"
    monkeypatch.setattr(f"{here}.flights.trajectory.check_inside", lambda *_: None)
    monkeypatch.setattr(f"{here}.flights.trajectory_files.read_trajectory", mock.MagicMock())
    monkeypatch.setattr(f"{here}.flights.trajectory.trajectory_poses", mock.MagicMock())
    monkeypatch.setattr(f"{here}.export.frame_list.FrameList", mock.MagicMock())
    monkeypatch.setattr(f"{here}.export.frames.render_frames", render)
    asked = ("mini", "render", "--trajectory", "x.csv", "--out", tmp_path / "out", "--jobs", 1)
    assert run_main(*asked, "--progress") == 0
    reported_stage(capsys, "rendering")
