"""The made-up survey as OpenDroneMap leaves it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.datasets.surveys.survey import (
    CENTRE,
    CRS,
    FOCAL,
    NAMES,
    PHOTO,
    SIZE_M,
    Made,
    local_frame,
)
from tests.support import write_raster


def opensfm(
    rotation: np.ndarray, centres: np.ndarray, made: Made, keys: list[int]
) -> dict[str, Any]:
    width, height = PHOTO
    camera = {
        "projection_type": "brown",
        "width": width,
        "height": height,
        "focal_x": FOCAL / width,
        "focal_y": FOCAL / width,
        "c_x": (CENTRE[0] - width / 2) / width,
        "c_y": (CENTRE[1] - height / 2) / width,
        **made.lens,
    }
    shots = {
        NAMES[row]: {
            "camera": "v2 dji fc 40 30 brown 0.8",
            "rotation": Rotation.from_matrix(rotation[row]).as_rotvec().tolist(),
            "translation": (-rotation[row] @ centres[row]).tolist(),
            "orientation": 1,
        }
        for row in keys
    }
    points = {"1": {"coordinates": [0, 0, 0], "color": [1, 2, 3]}}
    cameras = {"v2 dji fc 40 30 brown 0.8": camera}
    return {"cameras": cameras, "shots": shots, "points": points}


def write_odm_part(made: Made, part: Path, rows: list[int]) -> None:
    """Write a project's, or a submodel's, shots."""
    for folder in ("opensfm", "odm_georeferencing"):
        (part / folder).mkdir(parents=True, exist_ok=True)
    matrix4, rotation, centres = local_frame(made)
    content = opensfm(rotation, centres, made, rows)
    (part / "odm_georeferencing/coords.txt").write_text("WGS84 UTM 33N\n620000 5200000\n1 2 3\n")
    (part / "opensfm/reconstruction.json").write_text(json.dumps([content]))
    np.savetxt(part / "opensfm/geocoords_transformation.txt", matrix4)


def odm_project(made: Made) -> Path:
    """Write a project: photos, RGBA orthophoto, surface model, shots."""
    import rasterio

    project = made.folder / "project"
    for folder in ("images", "odm_orthophoto", "odm_dem", "odm_georeferencing"):
        (project / folder).mkdir(parents=True, exist_ok=True)
    for name in NAMES:
        (project / "images" / name).write_bytes((made.images / name).read_bytes())
    with rasterio.open(made.dom) as raster:
        bands, transform = raster.read(), raster.transform
    alpha = np.full((1, *SIZE_M), 255, np.uint8)
    write_raster(
        project / "odm_orthophoto/odm_orthophoto.tif",
        np.concatenate((bands, alpha)),
        crs=CRS,
        transform=transform,
    )
    (project / "odm_dem/dsm.tif").write_bytes(made.dsm.read_bytes())
    write_odm_part(made, project, list(range(5)))
    return project


def odm_layout(made: Made) -> list[object]:
    return ["odm", "--source", odm_project(made)]


def odm_newer_layout(made: Made) -> list[object]:
    """Write reconstruction.json in the CRS less the offset, the local one next to it."""
    project = odm_project(made)
    local = project / "opensfm/reconstruction.json"
    local.rename(project / "opensfm/reconstruction.topocentric.json")
    (project / "opensfm/geocoords_transformation.txt").unlink()
    content = opensfm(made.rotation, made.centres - (620000, 5200000, 0), made, list(range(5)))
    local.write_text(json.dumps([content]))
    return ["odm", "--source", project]
