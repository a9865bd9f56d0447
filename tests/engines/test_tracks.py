"""The same bytes from every engine, for predictions of all tracks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.registry import load_track
from airzoo_bench.engines.engine import Processes, open_engine
from airzoo_bench.evaluation.evaluate import SceneStore, evaluate, save
from airzoo_bench.evaluation.track import Run, SceneScores
from airzoo_bench.formats.clouds.cloud import open_cloud
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import read_truth
from tests.support import run_main

ALONE = Run()
TRACKS = ("retrieval", "matching", "reconstruction")
FILES = ("records.csv", "result.json")
MATCHES = "submissions/airzoo-demo/matching/sift/sift-matches.npz"


@pytest.fixture(scope="module")
def predictions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a prediction of each track that makes it work: descriptors, matches, clouds."""
    home = tmp_path_factory.mktemp("predictions")
    benchmark = find_benchmark("airzoo-demo", Path())
    return {
        "retrieval": descriptors(benchmark, home / "descriptors.npz"),
        "matching": few_matches(home / "matches.npz"),
        "reconstruction": noisy_clouds(benchmark, home / "clouds"),
    }


def noisy_clouds(benchmark: Benchmark, folder: Path) -> Path:
    """Take a share of the true points and move them."""
    random = np.random.default_rng(1)
    folder.mkdir()
    (folder / "protocol.txt").write_text(f"{benchmark.file.name}-reconstruction")
    for scene in (one.id for one in benchmark.file.scenes):
        truth = read_reconstruction(benchmark, scene)
        cloud = open_cloud(truth.cloud, limit_bytes=1 << 30, sampling=None)
        points = np.concatenate([piece.points for piece in cloud.pieces(1 << 20)])[::50]
        np.save(folder / f"{scene}.npy", points + random.normal(0, 0.5, points.shape))
        poses, names = truth.poses, truth.photos["image"].to_numpy(str)
        extrinsics = np.concatenate([poses.rotation, poses.translation[..., None]], axis=2)
        np.savez(folder / f"{scene}.cameras.npz", image_names=names, extrinsics=extrinsics)
    return folder


def few_matches(path: Path) -> Path:
    """Write the matches of ten queries, which are solved soon."""
    with np.load(Path(__file__).parents[2] / MATCHES) as found:
        arrays = dict(found)
    arrays["query_ids"], arrays["offsets"] = arrays["query_ids"][:10], arrays["offsets"][:11]
    for name in ("query_xy", "map_xy"):
        arrays[name] = arrays[name][: arrays["offsets"][-1]]
    np.savez(path, **arrays)
    return path


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


def saved(track: str, predictions: Path, out: Path, run: Run = ALONE) -> tuple[bytes, ...]:
    """Return the bytes of the records and of the result."""
    save(evaluate(predictions, data=Path(), track=track, run=run, method="m"), out)
    return tuple((out / name).read_bytes() for name in FILES)


@pytest.fixture(scope="module")
def here(
    predictions: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[bytes, ...]]:
    out = tmp_path_factory.mktemp("here")
    return {track: saved(track, predictions[track], out / track) for track in TRACKS}


@pytest.fixture(scope="module")
def run(request: pytest.FixtureRequest) -> Iterator[Run]:
    if request.param == "threads":
        yield Run(jobs=2)
        return
    where, jobs = ("dask", 2) if request.param == "dask" else ("local", request.param)
    with open_engine(where, jobs=jobs, here=Processes(jobs)) as engine:
        yield Run(engine=engine)


# Clouds are compared by threads alone.
ENGINES = [(track, engine) for engine in ("threads", 2) for track in TRACKS]
NIGHTLY = [(track, engine) for engine in (8, "dask") for track in TRACKS]


@pytest.mark.parametrize(
    ("track", "run"),
    [*ENGINES[:-1], *(pytest.param(*one, marks=pytest.mark.slow) for one in NIGHTLY)],
    indirect=["run"],
)
def test_any_engine_gives_the_same_bytes(
    track: str, run: Run, predictions: dict[str, Path], here: dict[str, object], tmp_path: Path
) -> None:
    assert saved(track, predictions[track], tmp_path / "out", run) == here[track]


def test_resume_goes_on_from_scored_scenes(
    predictions: dict[str, Path],
    here: dict[str, tuple[bytes, ...]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, kept, track = tmp_path / "out", tmp_path / "out.unfinished", "matching"
    ask = ["eval", track, predictions[track], "--out", out, "--method", "m", "--resume"]

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as stopping:
        stopping.setattr("airzoo_bench.evaluation.evaluate.PredictionsUsed", stop)
        assert run_main(*ask) == 130
    assert list(kept.glob("*.scene"))
    assert not (out / "result.json").exists()
    with monkeypatch.context() as resuming:
        resuming.setattr(type(load_track(track)), "score", stop)
        assert run_main(*ask) == 0
    assert tuple((out / name).read_bytes() for name in FILES) == here[track]
    assert not kept.exists()


def test_scenes_of_another_run_and_damaged_ones_are_not_used(tmp_path: Path) -> None:
    store = SceneStore(tmp_path / "kept", "one run")
    records = pd.DataFrame({"scene": ["park"], "error_m": [0.1], "points": [3]})
    scored = SceneScores(records.astype({"points": "Int64"}), {"queries": 1}, "poses", ("a note",))
    assert store.load("park") is None
    store.save("park", scored)
    kept = store.load("park")
    assert kept is not None
    pd.testing.assert_frame_equal(kept.records, scored.records)
    assert (kept.counts, kept.kind, kept.notes) == ({"queries": 1}, "poses", ("a note",))
    assert SceneStore(store.folder, "another run").load("park") is None
    (path,) = store.folder.glob("*.scene")
    path.write_bytes(path.read_bytes()[:-30])
    assert store.load("park") is None
    store.remove()
    assert not (tmp_path / "kept").exists()


def test_resume_needs_a_folder(
    predictions: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("eval", "matching", predictions["matching"], "--resume") == 2
    message = capsys.readouterr().err
    assert "--resume" in message
    assert "--out" in message
