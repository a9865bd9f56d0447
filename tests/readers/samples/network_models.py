"""COLMAP models, written byte by byte as COLMAP's format page describes them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from tests.readers.samples.true_views import TrueViews
from tests.reconstruction.world import PHOTO_SIZE

_RIGS = struct.Struct("<QIIii")


def write_model(
    folder: Path, views: TrueViews, size: tuple[int, int] = PHOTO_SIZE, *, tracks: bool = True
) -> Path:
    """Write cameras, images and points of true views; each point is seen by its own view."""
    folder.mkdir(parents=True)
    count = len(views.names)
    scale = size[0] / views.depth.shape[2]
    pinhole = (*(views.intrinsics[0, (0, 1), (0, 1)] * scale), size[0] / 2, size[1] / 2)
    cameras = [struct.pack("<IiQQ4d", n + 1, 1, *size, *pinhole) for n in range(count)]
    seen = views.depth > 0
    points = views.points[seen].astype("f4").astype(float)
    view_of = np.nonzero(seen)[0]
    images, bodies, total = [], [], np.zeros(count, int)
    for number, (point, view) in enumerate(zip(points, view_of, strict=True)):
        body = struct.pack("<Q3d3BdQ", number + 1, *point, 9, 9, 9, -1.0, int(tracks))
        bodies.append(body + struct.pack("<II", view + 1, total[view]) * tracks)
        total[view] += 1
    firsts = np.concatenate([[0], np.cumsum(total)])
    for n, (name, quaternion) in enumerate(zip(views.names, views.quaternions(), strict=True)):
        head = struct.pack("<I7dI", n + 1, *quaternion, *views.w2c[n, :3, 3], n + 1)
        # 2D points as VGGT leaves them: of two frames mixed up, far outside the photo.
        pixels = [struct.pack("<ddQ", 44.0, -218.8, firsts[n] + k + 1) for k in range(total[n])]
        used = pixels if tracks else []
        images.append(head + name.encode() + b"\0" + struct.pack("<Q", len(used)) + b"".join(used))
    for file, parts in (("cameras", cameras), ("images", images), ("points3D", bodies)):
        (folder / f"{file}.bin").write_bytes(struct.pack("<Q", len(parts)) + b"".join(parts))
    return folder


def write_points_ply(folder: Path, views: TrueViews) -> None:
    write_ply(folder / "points.ply", Cloud(views.points[views.depth > 0]))


def write_rigs(folder: Path, count: int) -> None:
    """Write the files that newer versions add: a rig an image, of one camera."""
    for name in ("rigs", "frames"):
        rows = [_RIGS.pack(1, n + 1, 1, 0, n + 1) for n in range(count)]
        (folder / f"{name}.bin").write_bytes(struct.pack("<Q", count) + b"".join(rows))
