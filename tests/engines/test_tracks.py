"""The same bytes from every engine, for predictions of all tracks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.engines.cluster import local_cluster
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.engines.kept import Kept, kept_folder
from airzoo_bench.engines.processes import Processes
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.retrieval.truth import read_truth
from tests.cli.results_of_all_tracks import TRACKS, _cloud, demo
from tests.support import run_main

WORKERS = (pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(4, marks=pytest.mark.slow))
KILLED = ("matching", pytest.param("retrieval", marks=pytest.mark.slow))
HOME = Path(__file__).resolve().parents[2]
COMMAND = "from airzoo_bench.cli.main import main; main()"


@pytest.fixture(scope="module")
def predictions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a prediction of each track that makes it work: descriptors, matches, clouds."""
    home = tmp_path_factory.mktemp("predictions")
    benchmark = demo()
    return {
        "retrieval": descriptors(benchmark, home / "descriptors.npz"),
        "matching": HOME / "submissions" / "airzoo-demo" / "matching" / "sift" / "sift-matches.npz",
        "reconstruction": _cloud(benchmark, 1, home),
    }


def descriptors(benchmark: Benchmark, path: Path) -> Path:
    random = np.random.default_rng(3)
    truths = [read_truth(benchmark.scene_folder(one.id), one.id) for one in benchmark.file.scenes]
    arrays = {"protocol": np.array(f"{benchmark.file.name}-retrieval")}
    for kind in ("query", "gallery"):
        tables = [truth.queries if kind == "query" else truth.tiles for truth in truths]
        arrays[f"{kind}_ids"] = np.concatenate([table["id"].to_numpy(str) for table in tables])
        size = (len(arrays[f"{kind}_ids"]), 16)
        # Few values, so that there are ties.
        arrays[f"{kind}_descriptors"] = random.integers(-2, 3, size).astype(np.float32)
    np.savez(path, **arrays)
    return path


def saved(
    track: str, predictions: Path, out: Path, engine: Engine = HERE, jobs: int = 1
) -> tuple[bytes, bytes]:
    """Return the bytes of the records and of the result."""
    resources = Resources(jobs=jobs, engine=engine)
    save(evaluate(predictions, data=Path(), track=track, resources=resources, method="m"), out)
    return (out / "records.csv").read_bytes(), (out / "result.json").read_bytes()


@pytest.fixture(scope="module")
def here(
    predictions: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[bytes, bytes]]:
    out = tmp_path_factory.mktemp("here")
    return {track: saved(track, predictions[track], out / track) for track in TRACKS}


@pytest.fixture(scope="module", params=WORKERS)
def cluster(request: pytest.FixtureRequest) -> Iterator[Engine]:
    with local_cluster(request.param, 1 << 30) as engine:
        yield engine


@pytest.mark.parametrize("track", TRACKS)
def test_two_threads_give_the_same_bytes(
    track: str, predictions: dict[str, Path], here: dict[str, object], tmp_path: Path
) -> None:
    assert saved(track, predictions[track], tmp_path / "out", jobs=2) == here[track]


@pytest.mark.parametrize("track", TRACKS)
def test_two_processes_give_the_same_bytes(
    track: str, predictions: dict[str, Path], here: dict[str, object], tmp_path: Path
) -> None:
    assert saved(track, predictions[track], tmp_path / "out", Processes(2)) == here[track]


@pytest.mark.parametrize("track", TRACKS)
def test_any_number_of_workers_gives_the_same_bytes(
    track: str,
    cluster: Engine,
    predictions: dict[str, Path],
    here: dict[str, object],
    tmp_path: Path,
) -> None:
    assert saved(track, predictions[track], tmp_path / "out", cluster) == here[track]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("track", KILLED)
def test_a_worker_killed_on_the_way_changes_no_byte(
    track: str,
    predictions: dict[str, Path],
    here: dict[str, object],
    tmp_path: Path,
) -> None:
    with local_cluster(2, 1 << 30) as engine:
        first = min(engine.client.run(os.getpid).values())
        killer = threading.Timer(0.3, os.kill, (first, signal.SIGKILL))
        killer.start()
        found = saved(track, predictions[track], tmp_path / "out", engine)
        killer.join()
    assert found == here[track]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("track", KILLED)
def test_a_client_killed_on_the_way_leaves_tasks_that_resume_goes_on_from(
    track: str,
    predictions: dict[str, Path],
    here: dict[str, tuple[bytes, bytes]],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    ask = ["eval", track, predictions[track], "--out", out, "--method", "m"]
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *map(str, ask), "--resume"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(HOME)},
    )
    while process.poll() is None and not list(kept_folder(out).glob("*.task")):
        time.sleep(0.01)
    process.kill()
    process.wait()
    if (out / "result.json").exists():
        pytest.skip(f"{track} was quicker than the signal")
    left = Kept(HERE, kept_folder(out), reuse=True).leftovers
    assert left > 0
    assert not (out / "result.json").exists()
    capfd.readouterr()
    assert run_main(*ask, "--resume", "--progress") == 0
    told = capfd.readouterr().err
    assert f"holds {left} finished task" in told
    assert (out / "records.csv").read_bytes() == here[track][0]
    assert (out / "result.json").read_bytes() == here[track][1]
    assert not kept_folder(out).exists()
