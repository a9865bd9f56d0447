"""UAV-VisLoc as it is downloaded: footprints and positives against geodesics of PROJ."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from pyproj import Geod

from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.published.uav_visloc import UAV_VISLOC, UavVisLocOptions
from airzoo_bench.datasets.settings import PrepareSettings
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.retrieval.positives import cast_footprints
from airzoo_bench.retrieval.truth import read_truth

EARTH = Geod(ellps="WGS84")
FOV_DEG = (52.0, 36.0)


@pytest.fixture
def root(tree: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return tree("uav-visloc") / "in"


def photos(root: Path, flight: str) -> list[tuple[float, float, float, float]]:
    """Return (lon, lat, height, heading) of a flight's photos; 07 has the heading of the README."""
    table = pd.read_csv(root / flight / f"{flight}.csv")
    headings = table["Phi1"] if "Phi1" in table else [-1.5] * len(table)
    return list(zip(table["lon"], table["lat"], table["height"], headings, strict=True))


def anchors(photo: tuple[float, float, float, float], share: float = 1.0) -> NDArray[np.float64]:
    """Return lon, lat of the corners of a footprint made smaller by `share`, over the ellipsoid.

    Top left, top right, bottom right, bottom left of the photo, its top towards the heading.
    """
    lon, lat, height, phi = photo
    half = height * np.tan(np.radians(FOV_DEG) / 2) * share
    corners = []
    for right, up in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
        bearing = phi + np.degrees(np.arctan2(right * half[0], up * half[1]))
        corners.append(EARTH.fwd(lon, lat, bearing, float(np.hypot(*half)))[:2])
    return np.array(corners)


def footprints(root: Path, flight: str) -> Floats:
    scene = UAV_VISLOC.read(UavVisLocOptions(root), flight, silent)
    assert scene.plane_height_m is not None
    posed = (scene.cameras, scene.poses, scene.crs, scene.plane_height_m)
    return cast_footprints(*posed, inset=0.0, max_range_m=5000.0, about_lon=115.0).lonlat


def test_footprints_are_those_of_the_ellipsoid(root: Path) -> None:
    """Scale of UTM is off by 0.1 % at most, which is 0.3 m at the corner of a footprint."""
    assert [*UAV_VISLOC.scenes(UavVisLocOptions(root.parent))] == ["01", "07", "09"]
    expected = np.stack([anchors(photo) for photo in photos(root, "07")])
    assert geodesic_distance_m(footprints(root, "07"), expected).max() < 0.3


def test_a_footprint_by_hand(root: Path) -> None:
    """At 405 m 52 and 36 degrees see 2 x 197.53 m across and 2 x 131.59 m along.

    Towards 165 degrees the top of the photo is south by east, and its left is east by north: the
    top left corner is 197.53 m towards 75 degrees and 131.59 m towards 165 degrees away, that is
    190.80 + 34.06 = 224.86 m east and 51.12 - 127.11 = -75.99 m north.
    """
    corner = footprints(root, "01")[0, 0]
    lon, lat, height, heading = photos(root, "01")[0]
    assert (height, heading) == (405.0, 165.0)
    east = geodesic_distance_m(np.array([lon, lat]), np.array([corner[0], lat]))
    north = geodesic_distance_m(np.array([lon, lat]), np.array([lon, corner[1]]))
    assert corner[0] > lon
    assert corner[1] < lat
    np.testing.assert_allclose([east, north], [224.86, 75.99], atol=0.1)


def test_positives_are_the_tiles_that_hold_an_anchor(root: Path, tmp_path: Path) -> None:
    """Of a flight with one map, and of one whose map is in four tiles."""
    settings = PrepareSettings(tmp_path / "data" / "folder", tmp_path / "data")
    UAV_VISLOC.prepare(UavVisLocOptions(root, ["01", "09"]), settings)
    for home in sorted((settings.folder / "scenes").iterdir()):
        truth = read_truth(home, home.name)
        boxes = truth.tiles[["lon_min", "lat_min", "lon_max", "lat_max"]].to_numpy()
        flight = photos(root, home.name)
        assert len(truth.queries) == len(flight)
        for query, photo in enumerate(flight):
            lon, lat = anchors(photo, share=7 / 8).T[..., None]
            held = (boxes[:, 0] <= lon) & (lon <= boxes[:, 2])
            held &= (boxes[:, 1] <= lat) & (lat <= boxes[:, 3])
            found = truth.positives.tiles[truth.positives.queries == query]
            assert sorted(found.tolist()) == np.flatnonzero(held.any(axis=0)).tolist()
