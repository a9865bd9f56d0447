"""Baselines run on benchmark folders: pictures in, a prediction file out."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.benchmark.images import read_grey, read_rgb_photo
from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, check_output_folder, write_npz
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.tiles import read_tile
from airzoo_bench.formats.clouds.ply_writer import write_ply
from airzoo_bench.matching.baseline import SiftSettings, Task, match_photos, plan
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.protocol.lookup import (
    MatchingProtocol,
    ReconstructionProtocol,
    RetrievalProtocol,
    protocol_of_track,
)
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.baseline import SfmResult, SfmSettings, sparse_reconstruction
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction_truth
from airzoo_bench.retrieval.baseline import Reader, VladSettings, describe
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["matching_baseline", "reconstruction_baseline", "retrieval_baseline"]

_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as in the grey of photos


def retrieval_baseline(
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: VladSettings,
    long_side_px: int = 1024,
    jobs: int = 1,
    progress: Progress = silent,
) -> None:
    """Describe every query and tile of a benchmark and write a prediction file.

    Parameters
    ----------
    protocol : str
        Name or path.
    out : Path
        The ``.npz`` to write.
    data : Path
        The benchmark folder, or the folder that holds it.
    settings : VladSettings
    long_side_px : int
        Photos are made this small.
    jobs : int
        Processes; the file does not depend on it.
    progress : Progress

    Raises
    ------
    UserError
        The protocol, the benchmark folder or a picture is not as it must be.
    """
    _check_npz(out)
    chosen = protocol_of_track(protocol, data, RetrievalProtocol)
    benchmark = find_benchmark(chosen.benchmark, data)
    benchmark.check_fits(chosen)
    parts: dict[str, list[NDArray[np.generic]]] = {}
    for scene in chosen.scenes:
        truth = read_truth(benchmark.scene_folder(scene.id), scene.id)
        tiles, photos = _readers(benchmark, truth, long_side_px)
        gallery, queries = describe(tiles, photos, settings, workers=jobs, progress=progress)
        for key, rows in {
            "query_ids": truth.queries["id"].to_numpy(str),
            "query_descriptors": queries,
            "gallery_ids": truth.tiles["id"].to_numpy(str),
            "gallery_descriptors": gallery,
        }.items():
            parts.setdefault(key, []).append(rows)
    arrays = {key: np.concatenate(rows) for key, rows in parts.items()}
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(chosen.name), **arrays})


def matching_baseline(
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: SiftSettings,
    jobs: int = 1,
    progress: Progress = silent,
) -> None:
    """Match every query of a benchmark to its crop and write a prediction file.

    Parameters
    ----------
    protocol : str
        Name or path.
    out : Path
        The ``.npz`` to write.
    data : Path
        The benchmark folder, or the folder that holds it.
    settings : SiftSettings
    jobs : int
        Processes; the file does not depend on it.
    progress : Progress

    Raises
    ------
    UserError
        The protocol, the benchmark folder or a picture is not as it must be.
    """
    _check_npz(out)
    chosen = protocol_of_track(protocol, data, MatchingProtocol)
    benchmark = find_benchmark(chosen.benchmark, data)
    benchmark.check_fits(chosen)
    ids: list[str] = []
    matches: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for scene in chosen.scenes:
        truth = read_matching_truth(benchmark, scene.id)
        ids += truth.queries["id"].tolist()
        tasks = _matching_tasks(benchmark, truth)
        matches += match_photos(tasks, settings, workers=jobs, progress=progress)
    offsets = np.concatenate([[0], np.cumsum([len(query_xy) for query_xy, _ in matches])])
    arrays = {
        "protocol": np.array(chosen.name),
        "query_ids": np.array(ids, dtype=str),
        "offsets": offsets.astype(np.int64),
        "query_xy": np.concatenate([np.zeros((0, 2)), *(query_xy for query_xy, _ in matches)]),
        "map_xy": np.concatenate([np.zeros((0, 2)), *(map_xy for _, map_xy in matches)]),
    }
    with atomic_write(out) as stream:
        write_npz(stream, arrays)


def reconstruction_baseline(
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: SfmSettings,
    jobs: int = 1,
    progress: Progress = silent,
    note: Callable[[str], None] = lambda _: None,
) -> None:
    """Reconstruct every scene of a benchmark by structure from motion, and write predictions.

    The frame is COLMAP's own: scoring aligns it by the cameras.

    Parameters
    ----------
    protocol : str
        Name or path.
    out : Path
        The folder to write: a cloud and cameras a scene. What a run that was stopped has made is
        kept beside it and taken up by the next.
    data : Path
        The benchmark folder, or the folder that holds it.
    settings : SfmSettings
    jobs : int
        Processes; the files do not depend on it.
    progress : Progress
    note : callable
        Takes a sentence on what came of a scene.

    Raises
    ------
    UserError
        The protocol, the benchmark folder or a picture is not as it must be.
    """
    chosen = protocol_of_track(protocol, data, ReconstructionProtocol)
    benchmark = find_benchmark(chosen.benchmark, data)
    benchmark.check_fits(chosen)
    check_output_folder(out, ("protocol.txt",))
    kept = out.with_name(f".{out.name}.unfinished")
    for scene in chosen.scenes:
        truth = read_reconstruction_truth(benchmark, scene.id)
        images = benchmark.resolve(benchmark.scene(scene.id).images)
        names = truth.photos["image"].tolist()
        cameras = truth.cameras
        found = sparse_reconstruction(
            [images / name for name in names],
            np.stack([cameras.width, cameras.height], axis=1),
            read_rgb_photo,
            settings,
            kept / scene.id,
            cameras=cameras,
            priors=_positions(truth),
            alignment=None,
            workers=jobs,
            progress=progress,
        )
        note(
            f"{scene.id}: {len(found.names)} of {found.photos} photos, {len(found.cloud):,} points"
        )
        _write_model(out, scene.id, found)
    with atomic_write(out / "protocol.txt", "w") as stream:
        stream.write(chosen.name + "\n")
    shutil.rmtree(kept, ignore_errors=True)


def _positions(truth: ReconstructionTruth) -> PosedCameras | None:
    """Return where GPS has the photos, for finding neighbours; never the true positions."""
    if not set(PRIOR_COLUMNS) <= set(truth.photos.columns):
        return None
    there = truth.photos.dropna(subset=list(PRIOR_COLUMNS))
    return PosedCameras(tuple(there["image"]), poses_of(there, PRIOR_COLUMNS).centres)


def _write_model(out: Path, scene: str, found: SfmResult) -> None:
    write_ply(out / f"{scene}.ply", found.cloud)
    arrays = {
        "image_names": np.array(found.names, dtype=str),
        "extrinsics": np.concatenate(
            [found.poses.rotation, found.poses.translation[..., None]], axis=2
        ),
    }
    with atomic_write(out / f"{scene}.cameras.npz") as stream:
        write_npz(stream, arrays)


def _matching_tasks(benchmark: Benchmark, truth: MatchingTruth) -> list[Task]:
    scene = benchmark.scene(truth.scene)
    images, cameras, priors = benchmark.resolve(scene.images), truth.cameras, truth.priors
    return [
        plan(
            images / name,
            cameras.take(row),
            priors.take(row),
            scene.crs,
            truth.dom,
            (int(x), int(y), int(width), int(height)),
            ground_height_m=scene.plane_height_m,
        )
        for row, (name, (x, y, width, height)) in enumerate(
            zip(truth.queries["image"], truth.crops, strict=True)
        )
    ]


def _check_npz(out: Path) -> None:
    if out.suffix != ".npz":
        raise UsageError("predictions are written as .npz", where=out, mend=f"name it {out}.npz")


def _readers(
    benchmark: Benchmark, truth: RetrievalTruth, long_side_px: int
) -> tuple[list[Reader], list[Reader]]:
    scene = benchmark.scene(truth.scene)
    gallery = benchmark.resolve(scene.gallery or scene.dom)
    images = benchmark.resolve(scene.images)
    tiles: list[Reader] = [partial(_grey_tile, gallery, tile) for _, tile in truth.tiles.iterrows()]
    photos: list[Reader] = [
        partial(read_grey, images / name, long_side_px) for name in truth.queries["image"]
    ]
    return tiles, photos


def _grey_tile(gallery: Path, tile: pd.Series[Any]) -> NDArray[np.uint8]:
    grey: NDArray[np.float64] = np.round(read_tile(gallery, tile) @ _GREY)
    return grey.astype(np.uint8)
