"""A reconstruction baseline that needs no weights: structure from motion over SIFT features.

Features and matches come from processes, the model from pycolmap. What a step has made is kept in
a folder under a name that says what it was made from, so that a run that was interrupted goes on
where it was, and one with other photos or settings does not take what is not its own.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, check_output_folder, write_npz
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.reconstruction.baseline_settings import SfmSettings
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.sfm.colmap import Model, lenses_of
from airzoo_bench.reconstruction.sfm.steps import (
    build_model,
    extract_features,
    list_photo,
    match_batch,
    plan_batches,
)
from airzoo_bench.reconstruction.truth import read_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["photo_pairs", "predict", "sparse_reconstruction"]

_LEAST_PHOTOS = 3


def predict(
    protocol: ReconstructionProtocol,
    benchmark: Benchmark,
    settings: SfmSettings,
    out: Path,
    run: Run,
    note: Callable[[str], None],
) -> None:
    """Reconstruct every scene, and write a cloud and cameras of each."""
    check_output_folder(out, ("protocol.txt",))
    kept = out.with_name(f".{out.name}.unfinished")
    for scene in protocol.scenes:
        truth = read_truth(benchmark, scene.id)
        images = benchmark.resolve(benchmark.scene(scene.id).images)
        names = truth.photos["image"].to_numpy(str)
        paths, positions = [images / name for name in names], _positions(truth.photos)
        found = sparse_reconstruction(
            paths, truth.cameras, positions, settings, kept / scene.id, run
        )
        posed = f"{len(found.rows)} of {len(names)} photos"
        note(f"{scene.id}: {posed}, {len(found.points):,} points")
        _write_model(out, scene.id, found, names[found.rows].tolist())
    with atomic_write(out / "protocol.txt", "w") as stream:
        stream.write(protocol.name + "\n")
    shutil.rmtree(kept, ignore_errors=True)


def _positions(photos: pd.DataFrame) -> Floats | None:
    """Return where GPS has the photos (N, 3), for finding neighbours; never the true positions."""
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return None
    known = photos[list(PRIOR_COLUMNS)].notna().all(axis=1).to_numpy()
    positions = np.full((len(photos), 3), np.nan)
    positions[known] = poses_of(photos[known], PRIOR_COLUMNS).centres
    return positions


def _write_model(out: Path, scene: str, found: Model, names: list[str]) -> None:
    write_ply(out / f"{scene}.ply", Cloud(found.points, found.colours))
    poses = found.poses
    extrinsics = np.concatenate([poses.rotation, poses.translation[..., None]], axis=2)
    with atomic_write(out / f"{scene}.cameras.npz") as stream:
        write_npz(stream, {"image_names": np.array(names, dtype=str), "extrinsics": extrinsics})


def sparse_reconstruction(
    photos: Sequence[Path],
    cameras: Cameras,
    positions: Floats | None,
    settings: SfmSettings,
    folder: Path,
    run: Run,
) -> Model:
    """Reconstruct photos by structure from motion."""
    if len(photos) < _LEAST_PHOTOS:
        raise UsageError(
            f"structure from motion needs {_LEAST_PHOTOS} photos, not {len(photos)}",
            fix="name a folder with photos that overlap",
        )
    engine, progress = run.processes, run.progress
    lenses = lenses_of(cameras)
    listed = [
        list_photo(path, lens, settings, folder) for path, lens in zip(photos, lenses, strict=True)
    ]
    missing = [photo for photo in listed if not photo.features.is_file()]
    extracted = engine.map(
        extract_features,
        missing,
        shared=settings,
        stage="features",
        name=lambda photo: str(photo.path),
    )
    for _ in progress(extracted, "features", len(missing)):
        pass
    pairs = photo_pairs(len(photos), positions, settings.neighbours)
    batches = plan_batches(listed, lenses, pairs, settings, folder)
    unmatched = [batch for batch in batches if not batch.matches.is_file()]
    matched = engine.map(
        match_batch,
        unmatched,
        shared=(settings, listed, lenses),
        stage="matches",
        name=lambda batch: str(listed[batch.first].path),
    )
    for _ in progress(matched, "matches", len(unmatched)):
        pass
    (model,) = progress(build_model(listed, lenses, batches, settings, folder), "model", 1)
    return model


def photo_pairs(count: int, positions: Floats | None, neighbours: int | None) -> Ints:
    """List pairs of photos to match, (P, 2): the first below the second; sorted."""
    first, second = np.triu_indices(count, k=1)
    if positions is None or neighbours is None or neighbours >= count - 1:
        return np.stack((first, second), axis=1)
    from scipy.spatial import cKDTree

    known = np.isfinite(positions).all(axis=1)
    wanted = np.zeros((count, count), np.bool_)
    wanted[~known] = True
    rows = np.flatnonzero(known)
    if len(rows):
        local = positions[rows] - positions[rows[0]]
        _, near = cKDTree(local).query(local, k=min(neighbours + 1, len(rows)))
        wanted[rows[:, None], rows[near.reshape(len(rows), -1)]] = True
    chosen = (wanted | wanted.T)[first, second]
    return np.stack((first[chosen], second[chosen]), axis=1)
