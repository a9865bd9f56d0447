"""One survey through the layouts of several programs: where they hold the same facts, one truth."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.progress import silent
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import rotations_to_angles
from tests.datasets.support import packet, write_photo

GROUND_M, SIZE = 100.0, (40, 30)


class Survey:
    """The survey of the goldens: five photos, tilted and turned, in a zone's east."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        file = json.loads((folder / "poses.json").read_text())
        self.crs, self.names = file["crs"], [*file["images"]]
        self.focal, self.centre = file["K"][0][0], (file["K"][0][2], file["K"][1][2])
        self.lens = file["distortion"]
        self.rotation = np.array([one["R_w2c"] for one in file["images"].values()])
        self.centres = np.array([one["center"] for one in file["images"].values()])
        self.lonlat = to_lonlat(self.crs, self.centres[:, :2])
        self.convergence = grid_convergence_deg(self.crs, self.lonlat)

    def read(self, dataset: str, source: str, images: str = "photos", **more: Any) -> NativeScene:
        """Read the survey from a source below its folder."""
        places = {name: self.folder / f"{name}.tif" for name in ("dom", "dsm")}
        given = {"source": self.folder / source, "images": self.folder / images, **places, **more}
        one = DATASETS.get(dataset)
        options = one.options(name="place", **given)
        (scene,) = one.scenes(options)
        return one.read(options, scene, silent)

    def table(self, header: str, *parts: np.ndarray, separator: str = ",", top: str = "") -> str:
        """Write a table of poses with all digits."""
        numbers = np.column_stack(parts).tolist()
        rows = [[name, *map(repr, row)] for name, row in zip(self.names, numbers, strict=True)]
        lines = [*[top] * bool(top), header, *(separator.join(row) for row in rows)]
        (self.folder / "table.csv").write_text("\n".join(lines) + "\n")
        return "table.csv"


def pix4d_table(made: Survey) -> NativeScene:
    """Write Pix4D's external camera parameters: blanks, projected, omega phi kappa by SciPy."""
    to_world = made.rotation.transpose(0, 2, 1) @ np.diag((1.0, -1.0, -1.0))
    angles = Rotation.from_matrix(to_world).as_euler("XYZ", degrees=True)
    header = "imageName X Y Z Omega Phi Kappa"
    source = made.table(header, made.centres, angles, separator=" ")
    return made.read("poses", source, camera=made.folder / "camera.json", crs=made.crs)


def metashape_table(made: Survey) -> NativeScene:
    """Write Metashape's reference: what was given (wrong here), then what was found."""
    ahead = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)]) @ made.rotation
    found = rotations_to_angles(ahead, convergence_deg=made.convergence)
    heights = made.centres[:, 2]
    header = (
        "#Label,X/Longitude,Y/Latitude,Z/Altitude,Yaw,Pitch,Roll,"
        "X_est,Y_est,Z_est,Yaw_est,Pitch_est,Roll_est"
    )
    given = (made.lonlat + 1e-4, heights + 5.0, found + 3.0)
    top = '#CoordinateSystem: GEOGCS["WGS 84",...]'
    source = made.table(header, *given, made.lonlat, heights, found, top=top)
    return made.read("poses", source, camera=made.folder / "camera.json")


def odm_project(made: Survey) -> NativeScene:
    return made.read("odm", "project", "project/images", dom=None, dsm=None)


def newer_odm_project(made: Survey) -> NativeScene:
    """Write reconstruction.json in the CRS less the offset, the local one next to it."""
    home = made.folder / "project" / "opensfm"
    (home / "geocoords_transformation.txt").unlink()
    path = (home / "reconstruction.json").rename(home / "reconstruction.topocentric.json")
    content = json.loads(path.read_text())
    rows = zip(made.names, made.rotation, made.centres - (620_000, 5_200_000, 0), strict=True)
    for name, rotation, centre in rows:
        shot = content[0]["shots"][name]
        shot["rotation"] = Rotation.from_matrix(rotation).as_rotvec().tolist()
        shot["translation"] = (-rotation @ centre).tolist()
    (home / "reconstruction.json").write_text(json.dumps(content))
    return odm_project(made)


def write_dji(made: Survey) -> None:
    """Write photos as a DJI drone with RTK does."""
    gimbal = rotations_to_angles(made.rotation, convergence_deg=made.convergence)
    cx, cy = np.subtract(made.centre, np.divide(SIZE, 2))
    lens = ",".join(map(repr, (made.focal, made.focal, float(cx), float(cy), *made.lens)))
    rows = zip(made.names, made.lonlat, made.centres, gimbal, strict=True)
    for flag, (name, lonlat, centre, angles) in zip((48, 49, 50, 50, 50), rows, strict=True):
        keys = ("GpsLongitude", "GpsLatitude", "RelativeAltitude")
        keys += ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree")
        values = zip(keys, (*lonlat, centre[2] - GROUND_M, *angles), strict=True)
        texts = {key: f"{value:+.9f}" for key, value in values}
        texts |= {"RtkFlag": str(flag), "DewarpFlag": "0", "DewarpData": f"2024-05-01;{lens}"}
        texts |= {"RtkStdLon": "0.010", "RtkStdLat": "0.010", "RtkStdHgt": "0.020"}
        gps = {5: b"\0", 6: centre[2]}
        write_photo(made.folder / "photos" / name, SIZE, gps, packet(**texts))


def colmap_in_the_crs(made: Survey) -> NativeScene:
    xyzw = Rotation.from_matrix(made.rotation).as_quat()
    lines = []
    for row, name in enumerate(made.names, 1):
        rotation, (x, y, z, w) = made.rotation[row - 1], xyzw[row - 1].tolist()
        moved = (-rotation @ made.centres[row - 1]).tolist()
        lines += [f"{row} {' '.join(map(repr, (w, x, y, z, *moved)))} 1 {name}", ""]
    (made.folder / "sparse/0/images.txt").write_text("\n".join(lines) + "\n")
    return made.read("colmap", "sparse/0", crs=made.crs)


def with_dji_photos(made: Survey, *source: str, **more: Any) -> NativeScene:
    write_dji(made)
    return made.read(*source, **more)


# With the most that a centre may be off, in metres: tables of DJI hold so many digits.
LAYOUTS: dict[str, tuple[Callable[[Survey], NativeScene], float]] = {
    "gimbal table": (
        lambda made: made.read("poses", "poses.csv", camera=made.folder / "camera.json"),
        1e-6,
    ),
    "Pix4D": (pix4d_table, 1e-6),
    "Metashape": (metashape_table, 1e-6),
    "ODM": (odm_project, 1e-6),
    "newer ODM": (newer_odm_project, 1e-6),
    "DJI": (lambda made: with_dji_photos(made, "dji", "photos"), 1e-3),
    # Their own positions are half a metre off, and time stamps are not.
    "stamped DJI": (lambda made: made.read("dji", "DJI_202405", "DJI_202405"), 1e-3),
    "COLMAP in the CRS": (colmap_in_the_crs, 1e-6),
    "COLMAP with matrix": (
        lambda made: made.read("colmap", "sparse/0", georeference=made.folder / "to_utm.txt"),
        1e-6,
    ),
    "COLMAP with GPS": (
        lambda made: with_dji_photos(made, "colmap", "sparse/0", from_exif=True),
        1e-2,
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_same_truth_as_own_photos(layout: Any, tmp_path: Path, tree: Callable[[str], Path]) -> None:
    folder = Path(shutil.copytree(tree("surveys"), tmp_path / "a b 测区"))
    made, (read, metres) = Survey(folder), LAYOUTS[layout]
    found = read(made)
    assert [*found.names] == made.names
    assert found.crs == made.crs
    np.testing.assert_allclose(found.poses.centres, made.centres, rtol=0, atol=metres)
    turn = 1e-4 if layout == "COLMAP with GPS" else 1e-8
    np.testing.assert_allclose(found.poses.rotation, made.rotation, rtol=0, atol=turn)
    lens = [*made.lens[:4], 0.0] if "COLMAP" in layout else made.lens  # without k3
    assert found.cameras.distortion == pytest.approx(np.tile(lens, (5, 1)), abs=2e-9)
    assert found.cameras.focal == pytest.approx(np.full((5, 2), made.focal), abs=2e-9)
    assert found.cameras.principal_point == pytest.approx(np.tile(made.centre, (5, 1)), abs=2e-9)
    assert found.dsm is not None
    assert found.dsm.read_bytes() == (folder / "dsm.tif").read_bytes()
    assert found.unposed == ()


def test_a_table_by_which_cameras_look_up_is_refused(
    tmp_path: Path, tree: Callable[[str], Path]
) -> None:
    made = Survey(Path(shutil.copytree(tree("surveys"), tmp_path / "surveys")))
    made.rotation = made.rotation @ np.diag((1.0, -1.0, -1.0))
    with pytest.raises(UsageError, match="omega-phi-kappa, 5 of 5 cameras"):
        pix4d_table(made)
