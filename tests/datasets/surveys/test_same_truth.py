"""One survey through the layouts of several programs: where they hold the same facts, one truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.surveys.colmap_models import (
    colmap_aligned_layout,
    colmap_exif_layout,
    colmap_matrix_layout,
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
