"""One made-up survey, its truth exactly known, in the layouts of several programs.

Five photos of 40 x 30 px, tilted and turned, over a map of 240 x 200 m in a UTM zone's east, where
the grid's north is 1.2 degrees off.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rasterio import Affine
from scipy.spatial.transform import Rotation

from airzoo_bench.core.progress import silent
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.photos import read_photos
from airzoo_bench.geometry.frames import to_lonlat
from airzoo_bench.geometry.rotations import angles_to_rotations, rotations_to_angles
from airzoo_bench.geometry.units import grid_convergence_deg
from tests.datasets.test_photo_metadata import packet
from tests.support import write_raster

CRS = "EPSG:32633"
CORNER = (620_000.0, 5_200_200.0)
SIZE_M = (200, 240)
GROUND_M = 100.0
PHOTO = (40, 30)
NAMES = ("DJI_0001.JPG", "DJI_0002.JPG", "DJI_0003.JPG", "DJI_0004.JPG", "DJI_0005.JPG")
FOCAL = 42.0
CENTRE = (20.5, 14.25)
LENS = {"k1": 0.02, "k2": -0.01, "p1": 0.001, "p2": -0.002, "k3": 0.003}
PINHOLE = dict.fromkeys(LENS, 0.0)
# From the map's north-west corner to the east and south, height; yaw from true north, pitch, roll.
_AT = ((60, 60, 180), (120, 50, 190), (180, 65, 185), (80, 140, 175), (160, 130, 195))
_ANGLES = ((10, -90, 0), (100, -85, 0), (-170, -80, 2), (280, -88, -1), (45, -75, 0))


@dataclass(frozen=True)
class Made:
    """Where the survey is.

    Attributes
    ----------
    rotation : (5, 3, 3) array
        World-to-camera.
    centres, lonlat : (5, 3), (5, 2) arrays
    """

    folder: Path
    rotation: np.ndarray
    centres: np.ndarray
    lonlat: np.ndarray
    lens: dict[str, float]

    @property
    def images(self) -> Path:
        return self.folder / "photos"

    @property
    def dom(self) -> Path:
        return self.folder / "dom.tif"

    @property
    def dsm(self) -> Path:
        return self.folder / "dsm.tif"

    @property
    def maps(self) -> list[object]:
        return ["--dom", self.dom, "--dsm", self.dsm]

    def gimbal(self, convergence: Any = None) -> np.ndarray:
        turn = grid_convergence_deg(CRS, self.lonlat) if convergence is None else convergence
        return rotations_to_angles(self.rotation, convergence_deg=turn)


def make_survey(folder: Path, lens: dict[str, float] = LENS) -> Made:
    """Write photos, map and surface model."""
    east, south, up = np.array(_AT, dtype=float).T
    centres = np.stack((CORNER[0] + east + 0.1372, CORNER[1] - south - 0.2913, up), axis=-1)
    lonlat = to_lonlat(CRS, centres[:, :2])
    convergence = grid_convergence_deg(CRS, lonlat)
    rotation = angles_to_rotations(*np.array(_ANGLES, float).T, convergence_deg=convergence)
    (folder / "photos").mkdir(parents=True)
    rng = np.random.default_rng(3)
    for name in NAMES:
        pixels = rng.integers(0, 256, (PHOTO[1], PHOTO[0], 3), np.uint8)
        Image.fromarray(pixels).save(folder / "photos" / name, "JPEG")
    transform = Affine(1, 0, CORNER[0], 0, -1, CORNER[1])
    ground = rng.integers(0, 256, (3, *SIZE_M), np.uint8)
    surface = GROUND_M + rng.uniform(0, 1, (1, *SIZE_M)).astype(np.float32)
    write_raster(folder / "dom.tif", ground, crs=CRS, transform=transform)
    write_raster(folder / "dsm.tif", surface, crs=CRS, transform=transform)
    return Made(folder, rotation, centres, lonlat, dict(lens))


def matrix() -> list[list[float]]:
    return [[FOCAL, 0.0, CENTRE[0]], [0.0, FOCAL, CENTRE[1]], [0.0, 0.0, 1.0]]


def photos_layout(made: Made) -> list[object]:
    """Write poses.json, and return the arguments of `prepare` but for name and tiles."""
    images = {
        name: {"R_w2c": rotation.tolist(), "center": centre.tolist()}
        for name, rotation, centre in zip(NAMES, made.rotation, made.centres, strict=True)
    }
    file = {"crs": CRS, "K": matrix(), "distortion": list(made.lens.values()), "images": images}
    path = made.folder / "poses.json"
    path.write_text(json.dumps(file))
    return ["photos", "--poses", path, "--images", made.images, *made.maps]


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


ANGLE = -0.013
LOCAL_SCALE = 0.99978


def local_frame(made: Made) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a similarity to the CRS as a matrix, and rotations and centres in the frame before."""
    turn = Rotation.from_euler("z", ANGLE).as_matrix()
    matrix4 = np.eye(4)
    matrix4[:3, :3] = LOCAL_SCALE * turn
    matrix4[:3, 3] = (CORNER[0] + 100, CORNER[1] - 90, 3.0)
    centres = (made.centres - matrix4[:3, 3]) @ turn / LOCAL_SCALE
    return matrix4, made.rotation @ turn, centres


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


def write_odm_part(
    made: Made,
    part: Path,
    rows: list[int],
    shots: bool = False,
    shift: tuple[float, ...] = (0, 0, 0),
) -> None:
    """Write a project's, or a submodel's, shots: as reconstruction.json, or else shots.geojson."""
    for folder in ("opensfm", "odm_report", "odm_georeferencing"):
        (part / folder).mkdir(parents=True, exist_ok=True)
    matrix4, rotation, centres = local_frame(made)
    content = opensfm(rotation, centres, made, rows)
    matrix4[:3, 3] += shift
    (part / "odm_georeferencing/coords.txt").write_text("WGS84 UTM 33N\n620000 5200000\n1 2 3\n")
    if not shots:
        (part / "opensfm/reconstruction.json").write_text(json.dumps([content]))
        np.savetxt(part / "opensfm/geocoords_transformation.txt", matrix4)
        return
    features = [
        {
            "type": "Feature",
            "properties": {
                "filename": NAMES[row],
                "camera": "v2 dji fc 40 30 brown 0.8",
                "focal": FOCAL / 40,
                "width": 40,
                "height": 30,
                "translation": made.centres[row].tolist(),
                "rotation": Rotation.from_matrix(made.rotation[row]).as_rotvec().tolist(),
            },
        }
        for row in rows
    ]
    (part / "odm_report/shots.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    camera = content["cameras"]["v2 dji fc 40 30 brown 0.8"]
    (part / "cameras.json").write_text(json.dumps({"dji fc 40 30 brown 0.8": camera}))


def odm_project(made: Made, *, shots: bool = False, surface: bool = True) -> Path:
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
    if surface:
        (project / "odm_dem/dsm.tif").write_bytes(made.dsm.read_bytes())
    write_odm_part(made, project, list(range(5)), shots)
    return project


def odm_layout(made: Made) -> list[object]:
    return ["odm", "--source", odm_project(made)]


def odm_shots_layout(made: Made) -> list[object]:
    return ["odm", "--source", odm_project(made, shots=True)]


def odm_newer_layout(made: Made) -> list[object]:
    """Write reconstruction.json in the CRS less the offset, the local one next to it."""
    project = odm_project(made)
    local = project / "opensfm/reconstruction.json"
    local.rename(project / "opensfm/reconstruction.topocentric.json")
    (project / "opensfm/geocoords_transformation.txt").unlink()
    content = opensfm(made.rotation, made.centres - (620000, 5200000, 0), made, list(range(5)))
    local.write_text(json.dumps([content]))
    return ["odm", "--source", project]


def write_photo(path: Path, values: dict[str, str], altitude: float, film_mm: int | None) -> None:
    """Write a photo with EXIF altitude and DJI's XMP."""
    exif = Image.Exif()
    exif.get_ifd(0x8825).update({5: b"\0", 6: altitude})
    if film_mm is not None:
        exif.get_ifd(0x8769)[0xA405] = film_mm
    attributes = " ".join(f'drone-dji:{key}="{value}"' for key, value in values.items())
    data = b"http://ns.adobe.com/xap/1.0/\0" + packet(attributes)
    stream = io.BytesIO()
    Image.new("L", PHOTO).save(stream, "JPEG", exif=exif)
    content = stream.getvalue()
    head = b"\xff\xe1" + (len(data) + 2).to_bytes(2)
    path.write_bytes(content[:2] + head + data + content[2:])


def dji_folder(
    made: Made,
    *,
    flags: tuple[int | None, ...] = (50,) * 5,
    off_deg: float = 0.0,
    changes: dict[str, str] | None = None,
    without: tuple[str, ...] = (),
    film_mm: int | None = None,
) -> Path:
    """Write photos as a DJI drone with RTK does; 1e-5 degrees are about a metre."""
    folder = made.folder / "DJI_202405"
    folder.mkdir(exist_ok=True)
    cx, cy = CENTRE[0] - PHOTO[0] / 2, CENTRE[1] - PHOTO[1] / 2
    lens = ",".join(f"{v:.9f}" for v in (FOCAL, FOCAL, cx, cy, *made.lens.values()))
    rows = zip(NAMES, made.lonlat, made.centres, made.gimbal(), flags, strict=True)
    for name, (lon, lat), centre, (yaw, pitch, roll), flag in rows:
        values = {
            "GpsLatitude": f"{lat + off_deg:+.9f}",
            "GpsLongitude": f"{lon:+.9f}",
            "AbsoluteAltitude": f"{centre[2]:+.3f}",
            "RelativeAltitude": f"{centre[2] - GROUND_M:+.3f}",
            "GimbalYawDegree": f"{yaw:+.9f}",
            "GimbalPitchDegree": f"{pitch:+.9f}",
            "GimbalRollDegree": f"{roll:+.9f}",
            "RtkFlag": str(flag),
            "RtkStdLon": "0.01000",
            "RtkStdLat": "0.01000",
            "RtkStdHgt": "0.02000",
            "DewarpFlag": "0",
            "DewarpData": f"2024-05-01;{lens}",
        } | (changes or {})
        left = ("RtkFlag", *without) if flag is None else without
        kept = {key: value for key, value in values.items() if key not in left}
        write_photo(folder / name, kept, centre[2], film_mm)
    return folder


def write_time_stamps(
    made: Made, folder: Path, suffixes: bool = True, off_deg: float = 0.0
) -> Path:
    """Write a table of time stamps, as a Matrice 4 does."""
    marks = ("N", "E", "V", "Lat", "Lon", "Ellh", "Q") if suffixes else ("",) * 7
    n, e, v, la, lo, h, q = (f",{mark}" if mark else "" for mark in marks)
    lines = [
        f"{row}\t282401.66{row}089\t[2404]\t   101{n}\t   -17{e}\t   129{v}\t"
        f"{lat + off_deg:.9f}{la}\t{lon:.9f}{lo}\t{centre[2]:.3f}{h}\t0.012, 0.016, 0.030\t50{q}"
        for row, ((lon, lat), centre) in enumerate(zip(made.lonlat, made.centres, strict=True), 1)
    ]
    path = folder / "DJI_202405_Timestamp.MRK"
    path.write_text("\n".join(lines) + "\n")
    return path


def prior_file(made: Made, east_deg: float) -> Path:
    """Write the truth as priors, some way east of it."""
    path = made.folder / "priors.csv"
    rows = zip(NAMES, made.lonlat, made.centres[:, 2], made.gimbal(), strict=True)
    lines = [
        f"{name},{lon + east_deg:.10f},{lat:.10f},{z},{','.join(map(str, angles))}"
        for name, (lon, lat), z, angles in rows
    ]
    header = "image,lon,lat,altitude_m,yaw_deg,pitch_deg,roll_deg"
    path.write_text("\n".join([header, *lines]))
    return path


def dji_layout(made: Made) -> list[object]:
    return ["dji", "--source", dji_folder(made), *made.maps]


def dji_stamped_layout(made: Made) -> list[object]:
    """Write photos whose own positions are half a metre off, and time stamps that are not."""
    folder = dji_folder(made, off_deg=5e-6, flags=(None,) * 5)
    write_time_stamps(made, folder)
    return ["dji", "--source", folder, *made.maps]


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


def colmap_names_layout(made: Made) -> list[object]:
    """Write positions by name, as model_aligner takes them, one of them 80 m off."""
    _, rotation, centres = local_frame(made)
    path = made.folder / "positions.txt"
    positions = made.centres.copy()
    positions[2, 0] += 80.0
    path.write_text(
        "".join(
            f"{n} {x!r} {y!r} {z!r}\n"
            for n, (x, y, z) in zip(NAMES, positions.tolist(), strict=True)
        )
    )
    return [*_colmap(made, colmap_model(made, rotation, centres)), "--georeference", path]


def colmap_exif_layout(made: Made) -> list[object]:
    _, rotation, centres = local_frame(made)
    model = colmap_model(made, rotation, centres)
    images = dji_folder(made)
    return ["colmap", "--source", model, "--images", images, *made.maps, "--from-exif"]


def options_of(arguments: list[object]) -> tuple[Any, Any]:
    """Return the dataset and its options, without the command line."""
    dataset = DATASETS.get(str(arguments[0]))
    given: dict[str, Any] = {}
    rest = iter(arguments[1:])
    for key in rest:
        field = str(key).removeprefix("--").replace("-", "_")
        given[field] = True if field == "from_exif" else next(rest)
    return dataset, dataset.options(name="place", **given)


def read_scene(arguments: list[object]) -> NativeScene:
    """Read a scene of a survey, or of own photos."""
    dataset, options = options_of(arguments)
    if arguments[0] == "photos":
        return read_photos(options, "place", silent)
    (scene,) = dataset.scenes(options)
    return dataset.read(options, scene, silent)
