"""UAV-VisLoc: eleven flights over China, a satellite map of each.

::

    NN/drone/NN_0001.JPG ...    photos of flights 01 to 11
    NN/NN.csv                   filename, lat, lon, height and headings, a row a photo
    NN/satelliteNN.tif          the map; of flight 09 in tiles, satellite09_01-01.tif and so on
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, UsageError, counted, readable
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.content import photo_sizes, utm_zone
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.places import find_home, join_maps, missing
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import UavVisLocOptions
from airzoo_bench.datasets.tables import match_every_row, read_table
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg
from airzoo_bench.geometry.poses import Poses, angles_to_rotations

_LAYOUT = "NN/drone/NN_0001.JPG ..., NN/NN.csv and NN/satelliteNN.tif of flights 01 to 11"
# Phi of each flight by the table in UAV-VisLoc's README.
_PHI = (165.0, 5.0, -40.0, 170.0, 100.0, -15.0, -1.5, 100.0, -50.0, 170.0, 90.0)
_FLIGHT_PHI = {f"{number:02d}": phi for number, phi in enumerate(_PHI, 1)}
_COLUMNS, _HEADING = ("filename", "lat", "lon", "height"), "Phi1"
_WITHOUT_HEADING = "07"  # whose table as published has no column of a heading
_SEA_LEVEL_SPREAD_M = 100.0
_ABOVE_GROUND_M = 500.0  # median of flights whose heights vary as above the sea


class _UavVisLoc(Dataset[UavVisLocOptions]):
    """Photos of eleven flights, to be found on a satellite map of each."""

    name = "uav-visloc"
    about = load_about("uav-visloc")
    options = UavVisLocOptions

    def benchmark_protocols(self, options: UavVisLocOptions, root: Path) -> BenchmarkProtocols:
        return BenchmarkProtocols.find((options.protocol,), root)

    def scenes(self, options: UavVisLocOptions) -> Mapping[str, Sequence[Path]]:
        root = find_home(options.source, lambda folder: bool(_flights(folder)), _LAYOUT)
        return {flight: sorted(folder.iterdir()) for flight, folder in _flights(root).items()}

    def read(self, options: UavVisLocOptions, scene: str, progress: Progress) -> NativeScene:
        root = find_home(options.source, lambda folder: bool(_flights(folder)), _LAYOUT)
        folder = _flights(root)[scene]
        table = _only(folder, rf"0?{int(scene)}\.csv", f"{scene}.csv")
        images = _only(folder, "drone", "drone")
        every = photo_sizes(images, progress)
        names, lonlat, height, heading, notes = _read_rows(table, every, scene)
        plane = _plane_height(height, scene, options, table, notes)
        dom = _flight_map(folder, scene, notes)
        tangents = np.tan(np.radians((options.fov_across / 2, options.fov_along / 2)))
        sizes = np.array([every[name] for name in names], dtype=np.int64)
        crs = utm_zone(lonlat)
        convergence = grid_convergence_deg(crs, lonlat)
        focal, bent, (wide, tall) = sizes / (2.0 * tangents), np.zeros((len(names), 5)), sizes.T
        cameras = Cameras(
            width=wide, height=tall, focal=focal, principal_point=sizes / 2.0, distortion=bent
        )
        rotations = angles_to_rotations(heading, -90.0, 0.0, convergence_deg=convergence)
        centres = np.column_stack([from_lonlat(crs, lonlat), height])
        return NativeScene(
            scene,
            images,
            *PosedPhotos(names, cameras, Poses(rotation=rotations, centres=centres), crs),
            dom=dom,
            plane_height_m=plane,
            unposed=tuple(sorted(set(every) - set(names))),
            notes=tuple(f"flight {scene}: {note}" for note in notes),
            poses_from=table,
        )


def _flights(root: Path) -> dict[str, Path]:
    """Return the folders of the flights that are there, by flight, in order."""
    folders = [p for p in root.iterdir() if re.fullmatch(r"\d{1,2}", p.name) and p.is_dir()]
    found = {f"{int(path.name):02d}": path for path in sorted(folders)}
    return {flight: found[flight] for flight in sorted(found) if flight in _FLIGHT_PHI}


def _only(folder: Path, pattern: str, name: str) -> Path:
    """Return the one entry of a folder that matches, whatever its case."""
    found = [p for p in sorted(folder.iterdir()) if re.fullmatch(pattern, p.name, re.IGNORECASE)]
    if len(found) == 1:
        return found[0]
    what = f"two files could be {name}" if found else f"lacks {name}"
    raise missing(what, folder, _LAYOUT)


def _read_rows(
    path: Path, photos: Iterable[str], flight: str
) -> tuple[tuple[str, ...], Floats, Floats, Floats, list[str]]:
    """Return names, longitude and latitude, heights, compass headings, and notes."""
    columns = {name: (name,) for name in (*_COLUMNS, _HEADING)}
    table = read_table(path, columns, (_HEADING,) if flight == _WITHOUT_HEADING else ())
    table.require_unique("filename")
    found = match_every_row(table, "filename", photos)
    lonlat = np.stack([table.numbers("lon", -180, 180), table.numbers("lat", -80, 84)], axis=1)
    heading, notes = np.full(len(table), np.nan), []
    if table.has(_HEADING):
        heading = table.numbers(_HEADING, -360, 360, empty=True)
    without = np.isnan(heading)
    if without.any():
        value = _FLIGHT_PHI[flight]
        heading = np.where(without, value, heading)
        count = f"{int(without.sum()):,} of {counted(len(table), 'photo')} have no heading"
        notes.append(f"{count}; they got {value:g} degrees, Phi of UAV-VisLoc's own table")
    return tuple(found.values()), lonlat, table.numbers("height", -500, 20_000), heading, notes


def _plane_height(
    heights: Floats, flight: str, options: UavVisLocOptions, path: Path, notes: list[str]
) -> float:
    """Return the height of the ground in the datum of the flight's heights."""
    low, middle, high = np.percentile(heights, (5, 50, 95)).tolist()
    given = dict(text.rpartition("=")[::2] for text in options.plane_height or ())
    text = given.get(flight, given.get("", ""))
    with readable(f"--plane-height {text}", "is no height", kind=UsageError):
        plane = float(text or "0")
    if not text and high - low > _SEA_LEVEL_SPREAD_M:
        plane = round(middle - _ABOVE_GROUND_M, 1)
        notes.append(
            f"heights vary from {low:.0f} to {high:.0f} m (5th to 95th percentile), so that they "
            f"are likely above sea level: the ground was put at {plane:g} m, {_ABOVE_GROUND_M:g} m "
            f"below their median; if you know better, say --plane-height {flight}=METRES"
        )
    below = int((heights <= plane).sum())
    if below:
        what = (
            f"{below:,} of {counted(len(heights), 'photo')} are at or below the ground, {plane:g} m"
        )
        raise BenchmarkError(what, where=path, fix=f"give --plane-height {flight}=METRES")
    return plane


def _flight_map(folder: Path, flight: str, notes: list[str]) -> Path:
    """Find a flight's map, or join its tiles."""
    whole = rf"(?:satellite)?0?{int(flight)}"
    tifs = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in (".tif", ".tiff")]
    tiles = [p for p in tifs if re.fullmatch(rf"{whole}_\d+-\d+", p.stem, re.IGNORECASE)]
    if not tiles or any(re.fullmatch(whole, path.stem, re.IGNORECASE) for path in tifs):
        return _only(folder, rf"{whole}\.tiff?", f"satellite{flight}.tif")
    path = join_maps(tiles, data_root() / "made" / "uav-visloc", f"satellite{flight}")
    notes.append(f"{path.name} was made of the {len(tiles)} tiles of its map")
    return path


UAV_VISLOC = _UavVisLoc()
