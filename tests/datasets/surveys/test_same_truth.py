"""One survey through the layouts of several programs: where they hold the same facts, one truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.retrieval.footprints import cast_footprints
from tests.datasets.published.uav_visloc_tree import FLIGHTS, make_tree
from tests.datasets.published.uav_visloc_tree import read as read_flight
from tests.datasets.surveys.colmap_models import (
    colmap_aligned_layout,
    colmap_exif_layout,
    colmap_matrix_layout,
    colmap_names_layout,
)
from tests.datasets.surveys.dji_folders import dji_layout, dji_stamped_layout
from tests.datasets.surveys.odm_projects import odm_layout, odm_newer_layout
from tests.datasets.surveys.pose_tables import gimbal_table, metashape_table, pix4d_table
from tests.datasets.surveys.survey import CRS, LENS, Made, make_survey, photos_layout, read_scene

# With the most that a centre may be off, in metres: tables of DJI hold so many digits.
EVERY: dict[str, tuple[Callable[[Made], list[object]], float]] = {
    "gimbal angles and degrees": (gimbal_table, 1e-6),
    "Pix4D's omega, phi, kappa": (pix4d_table, 1e-6),
    "Metashape's reference": (metashape_table, 1e-6),
    "OpenDroneMap": (odm_layout, 1e-6),
    "a newer OpenDroneMap": (odm_newer_layout, 1e-6),
    "DJI": (dji_layout, 1e-3),
    "DJI with time stamps": (dji_stamped_layout, 1e-3),
    "COLMAP in the CRS": (colmap_aligned_layout, 1e-6),
    "COLMAP and a matrix": (colmap_matrix_layout, 1e-6),
    "COLMAP and positions by name": (colmap_names_layout, 1e-6),
    "COLMAP and GPS": (colmap_exif_layout, 1e-2),
}


@pytest.mark.parametrize("layout", EVERY)
def test_same_truth_as_own_photos(layout: str, tmp_path: Path) -> None:
    lens = LENS | {"k3": 0.0} if "COLMAP" in layout else LENS
    made = make_survey(tmp_path / "a b 测区", lens)
    write, metres = EVERY[layout]
    expected = read_scene(photos_layout(made))

    found = read_scene(write(made))

    assert found.names == expected.names
    assert found.crs == expected.crs == CRS
    np.testing.assert_allclose(found.poses.centres, expected.poses.centres, rtol=0, atol=metres)
    turn = 1e-4 if layout == "COLMAP and GPS" else 1e-8
    np.testing.assert_allclose(found.poses.rotation, expected.poses.rotation, rtol=0, atol=turn)
    for part in ("width", "height", "focal", "principal_point", "distortion"):
        ours, theirs = (getattr(scene.cameras, part) for scene in (found, expected))
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-9)
    np.testing.assert_array_equal(*(open_heights(scene.dsm) for scene in (found, expected)))
    assert found.unposed == ()


def open_heights(path: Path | None) -> np.ndarray:
    import rasterio

    assert path is not None
    with rasterio.open(path) as raster:
        return raster.read(1)


def test_same_truth_as_uav_visloc(tmp_path: Path) -> None:
    """A flight of UAV-VisLoc, and a table of its angles with the camera of its fields of view."""
    flight = FLIGHTS["01"]
    root = make_tree(tmp_path / "UAV-VisLoc", {"01": flight})
    expected = read_flight(root, "01")
    lon, lat, height, phi = zip(*flight.photos, strict=True)
    yaw = (np.array(phi) + 180.0) % 360.0 - 180.0
    header = "image,longitude,latitude,altitude,GimbalYawDegree,GimbalPitchDegree,GimbalRollDegree"
    rows = zip(lon, lat, height, yaw.tolist(), strict=True)
    lines = [
        f"{flight.photo(i)},{x!r},{y!r},{z!r},{a!r},-90,0" for i, (x, y, z, a) in enumerate(rows)
    ]
    table, camera = tmp_path / "poses.csv", tmp_path / "camera.json"
    table.write_text("\n".join([header, *lines]) + "\n")
    images = root / "01" / "drone"
    wide, high = photo_size(images / flight.photo(0))
    focal = {"fx": wide / 2 / np.tan(np.radians(26)), "fy": high / 2 / np.tan(np.radians(18))}
    camera.write_text(json.dumps(focal | {"cx": wide / 2, "cy": high / 2}))
    sources = ["--source", table, "--images", images, "--dom", expected.dom, "--camera", camera]

    found = read_scene(["poses", *sources, "--crs", expected.crs, "--plane-height", 0.0])

    assert found.names == expected.names
    assert found.poses is not None
    assert expected.poses is not None
    np.testing.assert_allclose(found.poses.centres, expected.poses.centres, rtol=0, atol=1e-4)
    np.testing.assert_allclose(found.poses.rotation, expected.poses.rotation, rtol=0, atol=1e-8)
    seen = [
        cast_footprints(
            scene.cameras, scene.poses, scene.crs, 0.0, inset=0.0, max_range_m=5000.0
        ).lonlat
        for scene in (found, expected)
    ]
    np.testing.assert_allclose(*seen, rtol=0, atol=2.1e-9)  # 0.1 mm, as the table's digits
