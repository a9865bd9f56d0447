"""The demonstration: AirZoo-Mini, a plain method on every track, and its scores.

A track takes part by an entry in `_TRACKS`. What an earlier run has made and is still right is
kept, so that a run that was stopped goes on.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import airzoo_bench
from airzoo_bench.baselines import (
    matching_baseline,
    reconstruction_baseline,
    retrieval_baseline,
)
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import atomic_write, fingerprint
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.airzoo_mini import mini_protocols, prepare_airzoo_mini
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.matching.baseline import SiftSettings
from airzoo_bench.matching.track import evaluate_matching
from airzoo_bench.reconstruction.baseline import SfmSettings
from airzoo_bench.reconstruction.track import evaluate_reconstruction
from airzoo_bench.results.result import Result
from airzoo_bench.retrieval.baseline import VladSettings
from airzoo_bench.retrieval.track import evaluate_retrieval

__all__ = ["DemoTrack", "demo_benchmark", "demo_tracks", "run_track"]

_MEMORY_BYTES = 2 << 30
_PEAK_THRESHOLD = 0.02 / 3


@dataclass(frozen=True)
class DemoTrack:
    """A track of the demonstration.

    Attributes
    ----------
    name : str
    method : str
        What the plain method is called in tables.
    file : str
        What its predictions are called.
    predict : callable
        Takes protocol, predictions to write, data, jobs and progress.
    score : callable
        Takes predictions, data, jobs, progress, and the folder for the result.
    """

    name: str
    method: str
    file: str
    predict: Callable[[str, Path, Path, int, Progress], None]
    score: Callable[[Path, Path, str, int, Progress, Path], Result]


def demo_benchmark(
    root: Path,
    *,
    seed: int,
    jobs: int,
    progress: Progress = silent,
    note: Callable[[str], None] = lambda _: None,
) -> Path:
    """Return the folder of AirZoo-Mini, made now where it is not there or damaged.

    Parameters
    ----------
    root : Path
        The data root.
    seed, jobs, progress, note
        See `prepare_airzoo_mini`.

    Raises
    ------
    UserError
        A folder cannot be written, or the disk is full.
    """
    protocols = mini_protocols(seed)
    folder = root / protocols.retrieval.benchmark
    if folder.is_dir():
        try:
            benchmark = Benchmark.open(folder)
            for protocol in protocols.every:
                benchmark.check_fits(protocol)
        except BenchmarkError as fault:
            note(f"{fault.what}; {folder} is made again")
        else:
            return folder
    prepare_airzoo_mini(
        root, folder, protocols, seed=seed, jobs=jobs, replace=True, progress=progress, note=note
    )
    return folder


def demo_tracks() -> tuple[DemoTrack, ...]:
    """Return the tracks that there are."""
    return _TRACKS


def run_track(
    track: DemoTrack, data: Path, home: Path, *, seed: int, jobs: int, progress: Progress = silent
) -> Result:
    """Run a track's plain method and score it; predictions that are still right are kept.

    Parameters
    ----------
    track : DemoTrack
    data : Path
        The benchmark folder.
    home : Path
        Where predictions and results go, in a folder of the track's name.
    seed : int
        Of AirZoo-Mini.
    jobs : int
        Processes or threads; the numbers do not depend on it.
    progress : Progress

    Returns
    -------
    Result
        Also written, with its records.
    """
    protocols = {protocol.track: protocol for protocol in mini_protocols(seed).every}
    predictions = home / track.name / track.file
    mark = home / track.name / ".made-from.json"
    made_from = fingerprint(
        [airzoo_bench.__version__, protocols[track.name].settings(), _content(data)]
    )
    if not predictions.exists() or _read_mark(mark) != made_from:
        mark.unlink(missing_ok=True)
        track.predict(protocols[track.name].name, predictions, data, jobs, progress)
        with atomic_write(mark, "w") as stream:
            json.dump(made_from, stream)
    return track.score(predictions, data, track.method, jobs, progress, home / track.name)


def _content(data: Path) -> dict[str, str]:
    return Benchmark.open(data).file.checksums


def _read_mark(path: Path) -> str | None:
    try:
        return str(json.loads(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError):
        return None


def _describe(protocol: str, out: Path, data: Path, jobs: int, progress: Progress) -> None:
    settings = VladSettings(words=64, training_features=50_000, seed=0, doubled=False)
    retrieval_baseline(protocol, out, data=data, settings=settings, jobs=jobs, progress=progress)


def _rank(
    predictions: Path, data: Path, method: str, jobs: int, progress: Progress, out: Path
) -> Result:
    scored = evaluate_retrieval(
        predictions,
        data=data,
        method=method,
        memory_bytes=_MEMORY_BYTES,
        jobs=jobs,
        progress=progress,
    )
    save(scored, out)
    return scored.result


def _match(protocol: str, out: Path, data: Path, jobs: int, progress: Progress) -> None:
    settings = SiftSettings(
        max_features=8192,
        max_map_features=16384,
        peak_threshold=_PEAK_THRESHOLD,
        doubled=False,
        ratio=0.8,
        max_side_px=2000,
    )
    matching_baseline(protocol, out, data=data, settings=settings, jobs=jobs, progress=progress)


def _solve(
    predictions: Path, data: Path, method: str, jobs: int, progress: Progress, out: Path
) -> Result:
    scored = evaluate_matching(
        predictions,
        data=data,
        method=method,
        memory_bytes=_MEMORY_BYTES,
        jobs=jobs,
        progress=progress,
    ).evaluation
    save(scored, out)
    return scored.result


def _reconstruct(protocol: str, out: Path, data: Path, jobs: int, progress: Progress) -> None:
    settings = SfmSettings(
        long_side_px=640,
        max_features=1500,
        peak_threshold=_PEAK_THRESHOLD,
        doubled=False,
        ratio=0.8,
        neighbours=8,
        least_inliers=15,
        max_error_px=4.0,
        seed=0,
    )
    reconstruction_baseline(
        protocol, out, data=data, settings=settings, jobs=jobs, progress=progress
    )


def _compare(
    predictions: Path, data: Path, method: str, jobs: int, progress: Progress, out: Path
) -> Result:
    scored = evaluate_reconstruction(
        predictions,
        data=data,
        method=method,
        memory_bytes=_MEMORY_BYTES,
        jobs=jobs,
        progress=progress,
    ).evaluation
    save(scored, out)
    return scored.result


_TRACKS = (
    DemoTrack("retrieval", "SIFT and VLAD", "sift-vlad.npz", _describe, _rank),
    DemoTrack("matching", "SIFT", "sift-matches.npz", _match, _solve),
    DemoTrack("reconstruction", "Structure from motion", "sfm", _reconstruct, _compare),
)
