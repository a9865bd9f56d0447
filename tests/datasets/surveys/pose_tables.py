"""The made-up survey as tables of poses: by column names, and as Pix4D and Metashape write them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.crs import grid_convergence_deg
from airzoo_bench.geometry.poses import rotations_to_angles
from tests.datasets.surveys.survey import CENTRE, CRS, FOCAL, NAMES, Made


def camera_file(made: Made) -> Path:
    path = made.folder / "camera.json"
    values = {"fx": FOCAL, "cx": CENTRE[0], "cy": CENTRE[1], **made.lens}
    path.write_text(json.dumps(values))
    return path


def write_table(
    made: Made, header: str, rows: list[list[object]], separator: str = ",", top: str = ""
) -> list[object]:
    path = made.folder / "poses.csv"
    lines = [separator.join(map(str, row)) for row in rows]
    path.write_text("\n".join([*([top] if top else []), header, *lines]) + "\n", encoding="utf-8")
    camera = ["--camera", camera_file(made)]
    return ["poses", "--source", path, "--images", made.images, *made.maps, *camera]


def exact(*parts: np.ndarray) -> list[list[object]]:
    """Return rows of names and numbers, with all digits."""
    return [
        [name, *map(repr, map(float, row))]
        for name, row in zip(NAMES, np.column_stack(parts), strict=True)
    ]


def gimbal_table(made: Made) -> list[object]:
    header = "image,longitude,latitude,altitude,GimbalYawDegree,GimbalPitchDegree,GimbalRollDegree"
    rows = exact(made.lonlat, made.centres[:, 2], made.gimbal())
    return write_table(made, header, rows)


def photogrammetric(made: Made) -> np.ndarray:
    """Return omega, phi, kappa by SciPy."""
    to_world = made.rotation.transpose(0, 2, 1) @ np.diag((1.0, -1.0, -1.0))
    return Rotation.from_matrix(to_world).as_euler("XYZ", degrees=True)


def pix4d_table(made: Made) -> list[object]:
    """Write as Pix4D's external camera parameters: blanks, projected, omega phi kappa."""
    rows = exact(made.centres, photogrammetric(made))
    arguments = write_table(made, "imageName X Y Z Omega Phi Kappa", rows, " ")
    return [*arguments, "--crs", CRS]


def metashape_table(made: Made) -> list[object]:
    """Write as Metashape's reference: what was given (wrong here), then what was found."""
    ahead = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)]) @ made.rotation
    found = rotations_to_angles(ahead, convergence_deg=grid_convergence_deg(CRS, made.lonlat))
    given = np.column_stack((made.lonlat + 1e-4, made.centres[:, 2] + 5.0, found + 3.0))
    header = (
        "#Label,X/Longitude,Y/Latitude,Z/Altitude,Yaw,Pitch,Roll,"
        "X_est,Y_est,Z_est,Yaw_est,Pitch_est,Roll_est"
    )
    rows = exact(given, made.lonlat, made.centres[:, 2], found)
    return write_table(made, header, rows, top='#CoordinateSystem: GEOGCS["WGS 84",...]')
