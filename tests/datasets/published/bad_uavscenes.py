"""Downloads of UAVScenes as they should not be, and what `prepare` says of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.datasets.published.uavscenes_tree import make_place, make_run


def _entries(change: Callable[[list[dict[str, Any]]], object]) -> Callable[[Path], object]:
    return lambda source: make_run(source, change=change)


def _turned(entries: list[dict[str, Any]]) -> None:
    for entry in entries:
        entry["T4x4"] = np.array(entry["T4x4"]).T.tolist()


def _zipped(source: Path) -> None:
    shutil.rmtree(source / "interval5_CAM_LIDAR")
    (source / "interval5_CAM_LIDAR.zip.part").write_bytes(b"PK")


def _mesh_only(source: Path) -> None:
    shutil.rmtree(source / "terra_3dmap_pointcloud_mesh/AMtown")
    (source / "terra_3dmap_pointcloud_mesh/AMvalley").mkdir()


def _cut(source: Path) -> None:
    cloud = source / "terra_3dmap_pointcloud_mesh/AMtown/cloud_merged.ply"
    cloud.write_bytes(cloud.read_bytes()[:-1000])


SPOILED: dict[str, tuple[Callable[[Path], object], str]] = {
    "not unpacked": (_zipped, "unfinished download, interval5_CAM_LIDAR.zip.part"),
    "an unknown run": (
        lambda source: make_run(source, "AMtwon01"),
        "unknown runs: 1 of 2 (AMtwon01) (did you mean 'AMtown01'",
    ),
    "two poses of a photo": (
        _entries(lambda entries: entries.append(entries[0] | {"T4x4": entries[7]["T4x4"]})),
        "two poses of '1658137057.641204937.jpg'",
    ),
    "matrices by columns": (_entries(_turned), "transpose them"),
    "another stated size": (
        _entries(lambda entries: [e.update(Width=2448, Height=2048) for e in entries]),
        "is 48x36 px, not 2448x2048",
    ),
    "no cloud": (_mesh_only, "there is no cloud for AMtown01: there are 1 (AMvalley/)"),
    "half a cloud": (_cut, "cloud_merged.ply"),
    "the cloud of another place": (
        lambda source: make_place(source, shift=(0.0, 900.0, 0.0)),
        "0 of 6 photos looked at it",
    ),
}
