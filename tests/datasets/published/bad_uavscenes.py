"""Downloads of UAVScenes as they should not be, and what `prepare` says of them."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.datasets.published.uavscenes_tree import make_place, make_run, samples, stamp


def _entries(change: Callable[[list[dict[str, Any]]], object]) -> Callable[[Path], object]:
    return lambda source: make_run(source, change=change)


def _turned(entries: list[dict[str, Any]]) -> None:
    for entry in entries:
        entry["T4x4"] = np.array(entry["T4x4"]).T.tolist()


def _poses(source: Path) -> Path:
    return source / "interval5_CAM_LIDAR/interval5_AMtown01/sampleinfos_interpolated.json"


def _text(text: str) -> Callable[[Path], object]:
    return lambda source: _poses(source).write_text(text)


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
    "a run twice": (
        lambda source: shutil.copytree(
            source / "interval5_CAM_LIDAR/interval5_AMtown01", source / "interval5_AMtown01"
        ),
        "two folders claim to be the run interval5_AMtown01",
    ),
    "no poses": (lambda source: _poses(source).unlink(), "no such file of poses"),
    "no photos": (
        lambda source: shutil.rmtree(_poses(source).parent / "interval5_CAM"),
        "holds no photo",
    ),
    "a photo twice": (
        lambda source: shutil.copy(
            _poses(source).parent / f"interval5_CAM/{stamp(0)}.jpg",
            _poses(source).parent / f"interval5_CAM/{stamp(0).replace('.', '_')}.jpg",
        ),
        "claim to be one photo",
    ),
    "poses of another run": (
        _entries(
            lambda entries: [
                entry.update(OriginalImageName=f"9{entry['OriginalImageName']}")
                for entry in entries
            ]
        ),
        "names none of 6 photos, but '91658137057.641204937.jpg'",
    ),
    "two poses of a photo": (
        _entries(lambda entries: entries.append(entries[0] | {"T4x4": entries[7]["T4x4"]})),
        "two poses of '1658137057.641204937.jpg'",
    ),
    "matrices by columns": (_entries(_turned), "transpose them"),
    "a missing key": (_entries(lambda entries: entries[3].pop("P3x3")), "key '3.P3x3' is missing"),
    "NaN": (
        _entries(lambda entries: entries[0]["T4x4"][0].__setitem__(0, float("nan"))),
        "0.T4x4.0.0",
    ),
    "a mirror": (
        _entries(lambda entries: [e["T4x4"][0].__setitem__(0, -e["T4x4"][0][0]) for e in entries]),
        "rotation",
    ),
    "intrinsics of another size": (
        _entries(lambda entries: [e["P3x3"][0].__setitem__(2, 1224.0) for e in entries]),
        "camera matrices of another image size",
    ),
    "another stated size": (
        _entries(lambda entries: [e.update(Width=2448, Height=2048) for e in entries]),
        "is 48x36 px, not 2448x2048",
    ),
    "half a file": (lambda source: _text(json.dumps(samples())[:5000])(source), "not valid JSON"),
    "deep JSON": (_text("[" * 100_000), "JSON"),
    "larger than any": (lambda source: os.truncate(_poses(source), 200 << 20), "too large for a"),
    "an object": (_text('{"a": 1}'), "list"),
    "an empty list": (_text("[]"), "at least 1 item"),
    "no cloud": (_mesh_only, "there is no cloud for AMtown01: there are 1 (AMvalley/)"),
    "half a cloud": (_cut, "cloud_merged.ply"),
    "the cloud of another place": (
        lambda source: make_place(source, shift=(0.0, 900.0, 0.0)),
        "0 of 6 photos looked at it",
    ),
    "clouds in two places": (
        lambda source: shutil.copytree(
            source / "terra_3dmap_pointcloud_mesh/AMtown",
            source / "terra_3dmap_pointcloud_mesh/terra_3dmap_pointcloud_mesh/AMtown",
        ),
        "several clouds could be that of AMtown01",
    ),
}
