"""Competitions of tiny benchmarks, and Codabench's rules and folders, written from its sources."""

from __future__ import annotations

import contextlib
import datetime
import importlib
import io
import os
import shlex
import shutil
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.matching.world import made_matching_protocol
from tests.matching.world import make_world as make_matching
from tests.reconstruction.world import make_world as make_reconstruction
from tests.reconstruction.world import predict_clouds, true_points
from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions

IMAGE = "registry.example.org/airzoo-bench:1"
PHASE = "Test,2027-01-01,2027-03-01"


@dataclass(frozen=True)
class Made:
    """A benchmark of one track, and predictions that score well on it."""

    track: str
    protocol: str
    data: Path
    predictions: Path

    @property
    def arguments(self) -> list[str]:
        return [self.protocol, "--data", str(self.data), "--phase", PHASE]


def make(track: str, folder: Path) -> Made:
    return {"retrieval": _retrieval, "matching": _matching, "reconstruction": _reconstruction}[
        track
    ](folder)


def _retrieval(folder: Path) -> Made:
    scenes = [
        MadeScene("east", [[q, q + 1] for q in range(12)], 16),
        MadeScene("west", [[q, q + 1] for q in range(10)], 14),
    ]
    chosen = made_protocol(scenes)
    write_benchmark(folder / "data" / "made", chosen, scenes)
    ids, ranked = [], []
    for scene in scenes:
        for number, found in enumerate(scene.positives):
            first = [*found] if number % 3 else [(number + 7) % scene.n_tiles]
            rest = [t for t in range(scene.n_tiles) if t not in first]
            ids.append(scene.query(number))
            ranked.append([scene.tile(t) for t in [*first, *rest][:8]])
    path = write_predictions(
        folder / "preds.npz", chosen.name, query_ids=ids[:-1], ranked_ids=ranked[:-1]
    )
    return Made("retrieval", chosen.name, folder / "data", path)


def _matching(folder: Path) -> Made:
    world = make_matching(folder, made_matching_protocol())
    path = world.write(folder / "preds.npz", world.named(**world.poses()))
    return Made("matching", world.protocol.name, world.root, path)


def _reconstruction(folder: Path) -> Made:
    world = make_reconstruction(folder / "data")
    clouds = {"yard": true_points("yard") + np.array((0.1, 0.0, 0.05))}
    path = predict_clouds(world, folder / "preds", clouds)
    return Made("reconstruction", "made-reconstruction", world.root, path)


def check_competition(folder: Path) -> dict[str, Any]:
    """Hold a bundle to what Codabench's unpacker of version 2 and its models refuse."""
    stated = yaml.safe_load((folder / "competition.yaml").read_text(encoding="utf-8"))
    assert str(stated["version"]) == "2"
    assert 0 < len(stated["title"]) <= 256
    assert 0 < len(stated["docker_image"]) <= 128
    assert (folder / stated["image"]).read_bytes().startswith(b"\x89PNG")
    for file in [stated["terms"], *(page["file"] for page in stated["pages"])]:
        assert (folder / file).read_text(encoding="utf-8")
    indexes = [task["index"] for task in stated["tasks"]]
    assert len(indexes) == len(set(indexes)) > 0
    for task in stated["tasks"]:
        for part in ("scoring_program", "reference_data"):
            assert (folder / task[part]).exists()
    _check_phases(stated["phases"], indexes)
    [board] = stated["leaderboards"]
    assert len(board["title"]) <= 64
    assert len(board["key"]) <= 36
    keys = [column["key"] for column in board["columns"]]
    assert len(keys) == len(set(keys))
    for number, column in enumerate(board["columns"]):
        assert len(column["title"]) <= 36
        assert len(column["key"]) <= 36
        assert column["sorting"] in ("asc", "desc")
        assert column["index"] == number
    return dict(stated)


def _check_phases(phases: list[dict[str, Any]], tasks: list[int]) -> None:
    ends: list[datetime.date] = []
    for number, phase in enumerate(phases):
        assert set(phase["tasks"]) <= set(tasks)
        assert phase["tasks"]
        start = datetime.date.fromisoformat(phase["start"])
        if number:
            assert ends[number - 1] < start
        if number < len(phases) - 1 or "end" in phase:
            ends.append(datetime.date.fromisoformat(phase["end"]))


def unpacked(archive: Path, folder: Path) -> Path:
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(folder)
    return folder


@dataclass(frozen=True)
class Run:
    """What a scoring run left."""

    exit_code: int
    output: Path
    stderr: str


def run_scoring(
    bundle: Path, submitted: Path, app: Path, status: str | None = None, *, forked: bool = False
) -> Run:
    """Run the scoring command as Codabench's worker does, with /app in another place.

    Unless `forked`, the command's module is called in this process, which is faster.

    Its worker unpacks the archive of a submission, and adds a file ``metadata`` that says how the
    program in it ended: not at all, where it held only predictions.
    """
    shutil.rmtree(app, ignore_errors=True)
    for name in ("input", "output", "shared"):
        (app / name).mkdir(parents=True)
    shutil.copytree(bundle / "scoring_program", app / "program")
    shutil.copytree(bundle / "reference_data", app / "input" / "ref")
    shutil.copytree(submitted, app / "input" / "res")
    ended = "elapsedTime: null\nexitCode: null\ningestionElapsedTime: null\n"
    (app / "input" / "res" / "metadata").write_text(ended if status is None else status)
    stated = yaml.safe_load((app / "program" / "metadata.yaml").read_text())
    command = shlex.split(stated["command"].replace("/app/", f"{app}/"))
    module = "airzoo_bench.leaderboard.exports.scoring"
    assert command[:3] == ["python3", "-m", module]
    if not forked:
        with contextlib.redirect_stderr(io.StringIO()) as stderr:
            code = importlib.import_module(module).main(command[3:])
        return Run(code, app / "output", stderr.getvalue())
    done = subprocess.run(
        [sys.executable, *command[1:]],
        cwd=app / "program",
        env={"PATH": os.environ["PATH"], "PYTHONPATH": os.environ.get("PYTHONPATH", "")},
        capture_output=True,
        text=True,
        check=False,
    )
    return Run(done.returncode, app / "output", done.stderr)


def submitted_folder(folder: Path, predictions: Path) -> Path:
    """Lay predictions out as the platform unpacks their archive."""
    folder.mkdir(parents=True)
    copy = shutil.copytree if predictions.is_dir() else shutil.copyfile
    copy(predictions, folder / predictions.name)
    return folder


def broken_predictions(path: Path) -> Path:
    np.savez(path, nothing=np.zeros(3))
    return path
