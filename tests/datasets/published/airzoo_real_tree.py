"""AirZoo-Real, as it is downloaded, of a made-up place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.poses import matrix_to_quaternion
from tests.datasets.published.changsha import (
    EPSG,
    FOCAL_PX,
    Shot,
    poses_of_shots,
    write_map,
    write_photo,
    write_surface,
)

REGIONS = {"City": "Scene1", "Rural": "Scene2"}
SHOTS = {
    f"DJI_20240501120000_{number:04d}": Shot(
        140.0 + 30.0 * (number % 3), 180.0 + 20.0 * (number // 3), yaw=number * 30.0
    )
    for number in range(1, 6)
}
OFF = {"x": 0.8, "y": -0.6, "up": 0.5}
"""Of the photos' own positions, against the RTK table."""
DEWARP = f"2024-05-01;{FOCAL_PX},{FOCAL_PX},0.0,0.0,0.0,0.0,0.0,0.0,0.0"

SITE_SHOTS = {
    str(number): Shot(130.0 + 12.0 * number, 200.0 - 9.0 * (number % 4), yaw=number * 45.0)
    for number in range(8)
}
# A camera of 4032x3024 in the release; here 160x120, the photos a quarter of it.
WRITTEN_PX, PHOTO_PX = (160, 120), (40, 30)
WRITTEN_LENS = (150.0, 140.0, 80.0, 60.0)


def make_region(
    folder: Path,
    shots: Mapping[str, Shot] = SHOTS,
    *,
    rtk: bool = True,
    satellite: bool = True,
    flag: int = 50,
) -> Path:
    """Write a region: photos, DOM, DSM, perhaps a satellite map of 0.3 m and an RTK table."""
    for name, shot in shots.items():
        own = shot.moved(**OFF) if rtk else shot
        write_photo(folder / f"{name}_V.JPG", own, RtkFlag=f"{flag}", DewarpData=DEWARP)
    write_map(folder / "DOM.tif", 1.0, bare=True)
    write_surface(folder / "dsm.tif", 1.0)
    if satellite:
        write_map(folder / "map_L20.tif", 0.3, seed=2)
    if rtk:
        write_table(folder / "DJI_001_Timestamp.MRK", shots)
    (folder / "DJI_001_Rinex.obs").write_text("     3.03           OBSERVATION DATA\n")
    return folder


def write_table(path: Path, shots: Mapping[str, Shot], flag: int = 50) -> None:
    lines = []
    for name, shot in shots.items():
        x, y, z = shot.centre
        lon, lat = to_lonlat(EPSG, (x, y)).tolist()
        lines.append(
            f"{int(name[-4:])}\t285123.5\t[2312]\t  12,N\t  -3,E\t 190,V\t{lat:.9f},Lat"
            f"\t{lon:.9f},Lon\t{z:.3f},Ellh\t0.010321, 0.009, 0.025\t{flag},Q\n"
        )
    path.write_text("".join(lines))


def make_site(folder: Path, names: Sequence[str] = tuple(SITE_SHOTS)) -> Path:
    """Write a site at some hours: poses with OpenGL's axes, cameras of four times the size."""
    (folder / "images").mkdir(parents=True)
    poses = poses_of_shots(SITE_SHOTS)
    flip = np.diag((1.0, -1.0, -1.0))
    lines, lenses = [], []
    for number, name in enumerate(SITE_SHOTS):
        if name in names:
            for kind in range(3):
                Image.new("RGB", PHOTO_PX, (number, kind, 7)).save(
                    folder / "images" / f"{name}_{kind}.png"
                )
        rotation = flip @ poses.rotation[number]
        values = (*matrix_to_quaternion(rotation[None])[0], *(-rotation @ poses.centres[number]))
        lines.append(" ".join((f"images/{name}_0.png", *(f"{v:.17g}" for v in values))) + "\n")
        lens = " ".join(f"{value:g}" for value in (*WRITTEN_PX, *WRITTEN_LENS))
        lenses.append(f"images/{name}_0.png PINHOLE {lens}\n")
    for part, text in (("poses/t_pose", lines), ("intrinsics/t_intrinsic", lenses)):
        path = folder / "poses" / f"{part}.txt"
        path.parent.mkdir(parents=True)
        path.write_text("".join(text))
    (folder / "poses" / "times").mkdir()
    (folder / "poses" / "times" / "time.txt").write_text("0 112.98 28.28 150.0 0 -60 45\n")
    return folder


def make_tree(folder: Path) -> Path:
    """Write both regions, and two hours of two sites."""
    for scene in REGIONS.values():
        make_region(folder / scene)
    home = folder / "airzoo_real_recon"
    make_site(home / "xuexiao" / "06-08")
    make_site(home / "guangchang" / "18-20")
    write_surface(home / "dom" / "fcw_hangtian_DSM.tif", 0.5, bare=True, hole=True, nodata=None)
    return folder
