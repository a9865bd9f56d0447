"""Structure from motion run on a benchmark folder."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.core.files import atomic_write, check_output_folder, write_npz
from airzoo_bench.evaluation.baseline import Baseline
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.baseline import SfmResult, SfmSettings, sparse_reconstruction
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth, read_truth

__all__ = ["STRUCTURE_FROM_MOTION"]


def _predict(
    protocol: ReconstructionProtocol,
    benchmark: Benchmark,
    settings: SfmSettings,
    out: Path,
    resources: Resources,
    note: Callable[[str], None],
) -> None:
    """Reconstruct every scene, and write a cloud and cameras of each.

    The frame is COLMAP's own: scoring aligns it by the cameras. What a run that was stopped has
    made is kept beside `out` and taken up by the next.
    """
    check_output_folder(out, ("protocol.txt",))
    kept = out.with_name(f".{out.name}.unfinished")
    for scene in protocol.scenes:
        truth = read_truth(benchmark, scene.id)
        images = benchmark.resolve(benchmark.scene(scene.id).images)
        cameras = truth.cameras
        found = sparse_reconstruction(
            [images / name for name in truth.photos["image"]],
            np.stack([cameras.width, cameras.height], axis=1),
            read_rgb_photo,
            settings,
            kept / scene.id,
            cameras=cameras,
            priors=_positions(truth),
            alignment=None,
            workers=resources.jobs,
            progress=resources.progress,
        )
        note(
            f"{scene.id}: {len(found.names)} of {found.photos} photos, {len(found.cloud):,} points"
        )
        _write_model(out, scene.id, found)
    with atomic_write(out / "protocol.txt", "w") as stream:
        stream.write(protocol.name + "\n")
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


STRUCTURE_FROM_MOTION = Baseline(
    method="Structure from motion",
    summary="Reconstruct scenes by structure from motion (pycolmap): a sparse cloud and cameras.\n"
    "\nA run that was stopped goes on.",
    settings=SfmSettings(),
    demo=SfmSettings(long_side_px=640, max_features=1500, doubled=False, neighbours=8),
    out="sfm",
    out_help="The folder to write.",
    example="airzoo-mini-reconstruction --out sfm",
    predict=_predict,
)
