"""The made-up survey as a COLMAP model, with what places it in the CRS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.datasets.surveys.dji_folders import dji_folder
from tests.datasets.surveys.survey import CENTRE, CRS, FOCAL, NAMES, PHOTO, Made, local_frame


def colmap_model(made: Made, rotation: np.ndarray, centres: np.ndarray) -> Path:
    """Write a COLMAP model as text; OPENCV has no k3."""
    folder = made.folder / "sparse" / "0"
    folder.mkdir(parents=True)
    lens = [made.lens[key] for key in ("k1", "k2", "p1", "p2")]
    params = " ".join(map(repr, (FOCAL, FOCAL, *CENTRE, *lens)))
    (folder / "cameras.txt").write_text(f"# cameras\n1 OPENCV {PHOTO[0]} {PHOTO[1]} {params}\n")
    xyzw = Rotation.from_matrix(rotation).as_quat()
    lines = []
    for row, name in enumerate(NAMES):
        x, y, z, w = xyzw[row]
        t = -rotation[row] @ centres[row]
        numbers = " ".join(repr(float(value)) for value in (w, x, y, z, *t))
        lines += [f"{row + 1} {numbers} 1 {name}", ""]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text("# points\n")
    return folder


def _colmap(made: Made, model: Path) -> list[object]:
    return ["colmap", "--source", model, "--images", made.images, *made.maps]


def colmap_aligned_layout(made: Made) -> list[object]:
    return [*_colmap(made, colmap_model(made, made.rotation, made.centres)), "--crs", CRS]


def colmap_matrix_layout(made: Made) -> list[object]:
    matrix4, rotation, centres = local_frame(made)
    path = made.folder / "to_utm.txt"
    np.savetxt(path, matrix4, fmt="%.17g")
    return [*_colmap(made, colmap_model(made, rotation, centres)), "--georeference", path]


def colmap_exif_layout(made: Made) -> list[object]:
    _, rotation, centres = local_frame(made)
    model = colmap_model(made, rotation, centres)
    images = dji_folder(made)
    return ["colmap", "--source", model, "--images", images, *made.maps, "--from-exif"]
