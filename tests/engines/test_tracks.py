"""The same bytes from every engine, for predictions of all tracks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.registry import load_track
from airzoo_bench.engines.engine import open_engine
from airzoo_bench.evaluation.evaluate import evaluate, keep_scene, save, write_template
from airzoo_bench.evaluation.track import Run, SceneScores
from tests.support import run_main

ALONE = Run()
TRACKS = ("retrieval", "matching", "reconstruction")
FILES = ("records.csv", "result.json")
MATCHES = "submissions/airzoo-demo/matching/sift/sift-matches.npz"


@pytest.fixture(scope="module")
def predictions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return predictions of each track that make it work: descriptors, matches, depth maps."""
    home = tmp_path_factory.mktemp("predictions")
    found = {"matching": few_matches(home / "matches.npz")}
    for track, name, kind in (("retrieval", "a.npz", "descriptors"), ("reconstruction", "b", None)):
        protocol = f"airzoo-demo-{track}"
        found[track], _ = write_template(protocol, data=Path(), out=home / name, kind=kind)
    return found


def few_matches(path: Path) -> Path:
    """Write the matches of ten queries, which are solved soon."""
    with np.load(Path(__file__).parents[2] / MATCHES) as found:
        arrays = dict(found)
    arrays["query_ids"], arrays["offsets"] = arrays["query_ids"][:10], arrays["offsets"][:11]
    for name in ("query_xy", "map_xy"):
        arrays[name] = arrays[name][: arrays["offsets"][-1]]
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
    with open_engine(where, jobs=jobs, processes=jobs) as engine:
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


def test_resume_goes_on_from_scored_scenes(predictions, here, tmp_path, monkeypatch) -> None:
    out, kept, track = tmp_path / "out", tmp_path / "out.unfinished", "matching"
    ask = ["eval", track, predictions[track], "--out", out, "--method", "m", "--resume"]

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as stopping:
        stopping.setattr("airzoo_bench.results.result.PredictionsUsed", stop)
        assert run_main(*ask) == 130
    assert list(kept.glob("*.scene"))
    assert not (out / "result.json").exists()
    with monkeypatch.context() as resuming:
        resuming.setattr(type(load_track(track)), "score", stop)
        assert run_main(*ask) == 0
    assert tuple((out / name).read_bytes() for name in FILES) == here[track]
    assert not kept.exists()


def test_scenes_of_another_run_and_damaged_ones_are_not_used(tmp_path: Path) -> None:
    records = pd.DataFrame({"scene": ["park"], "error_m": [0.1], "points": [3]})
    scored = SceneScores(records.astype({"points": "Int64"}), {"queries": 1}, "poses", ["a note"])
    lacking = RuntimeError("it is scored again")

    def kept(run: str) -> SceneScores:
        def score() -> SceneScores:
            raise lacking

        return keep_scene(tmp_path, [run], score)

    assert keep_scene(tmp_path, ["one run"], lambda: scored) is scored
    found = kept("one run")
    pd.testing.assert_frame_equal(found.records, scored.records)
    assert (found.counts, found.kind, found.notes) == ({"queries": 1}, "poses", ["a note"])
    with pytest.raises(RuntimeError):
        kept("another run")
    (path,) = tmp_path.glob("*.scene")
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(RuntimeError):
        kept("one run")
