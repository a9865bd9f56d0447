"""The demonstration: AirZoo-Mini, a plain method on every track, and its scores.

What an earlier run has made and is still right is kept, so that a run that was stopped goes on.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import atomic_write, fingerprint
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.mini.prepare import mini_protocols, prepare_airzoo_mini
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.generate import run_baseline
from airzoo_bench.evaluation.given import AnyTrack
from airzoo_bench.evaluation.parts import Baseline, Resources
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.results.result import Result

__all__ = ["demo_benchmark", "demo_tracks", "run_track"]


def demo_benchmark(
    root: Path,
    *,
    seed: int,
    engine: Engine = HERE,
    progress: Progress = silent,
    note: Callable[[str], None] = lambda _: None,
) -> Path:
    """Return the folder of AirZoo-Mini, made now where it is not there or damaged.

    Parameters
    ----------
    root : Path
        The data root.
    seed, engine, progress, note
        See `dataset.PrepareSettings`.

    Raises
    ------
    UserError
        A folder cannot be written, or the disk is full.
    """
    protocols = mini_protocols(seed)
    folder = root / protocols.every[0].benchmark
    if folder.is_dir():
        try:
            benchmark = Benchmark.open(folder)
            for protocol in protocols.every:
                benchmark.check_fits(protocol)
        except BenchmarkError as fault:
            note(f"{fault.what}; {folder} is made again")
        else:
            return folder
    settings = PrepareSettings(
        folder, root, replace=True, engine=engine, progress=progress, note=note
    )
    prepare_airzoo_mini(seed, settings)
    return folder


def demo_tracks() -> list[tuple[AnyTrack, Baseline[object]]]:
    """Return the tracks that AirZoo-Mini has, with their plain methods."""
    tracks: list[AnyTrack] = [TRACKS.get(protocol.track) for protocol in mini_protocols(0).every]
    return [(track, track.baseline) for track in tracks if track.baseline is not None]


def run_track(
    track: AnyTrack,
    baseline: Baseline[object],
    data: Path,
    home: Path,
    *,
    seed: int,
    resources: Resources,
) -> Result:
    """Run a track's plain method and score it; predictions that are still right are kept.

    Parameters
    ----------
    track : Track
    baseline : Baseline
    data : Path
        The benchmark folder.
    home : Path
        Where predictions and results go, in a folder of the track's name.
    seed : int
        Of AirZoo-Mini.
    resources : Resources

    Returns
    -------
    Result
        Also written, with its records.
    """
    chosen = next(one for one in mini_protocols(seed).every if one.track == track.name)
    folder = home / track.name
    predictions, mark = folder / baseline.out, folder / ".made-from.json"
    made_from = fingerprint([__version__, chosen.settings(), Benchmark.open(data).file.checksums])
    if not predictions.exists() or _read_mark(mark) != made_from:
        mark.unlink(missing_ok=True)
        run_baseline(
            track.name,
            chosen.name,
            predictions,
            data=data,
            settings=baseline.demo,
            resources=resources,
        )
        with atomic_write(mark, "w") as stream:
            json.dump(made_from, stream)
    scored = evaluate(
        predictions, data=data, track=track.name, method=baseline.method, resources=resources
    )
    save(scored, folder)
    return scored.result


def _read_mark(path: Path) -> str | None:
    try:
        return str(json.loads(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError):
        return None
