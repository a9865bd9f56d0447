"""UAV-VisLoc as it is downloaded: what is read of a flight, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.datasets.published.uav_visloc import UAV_VISLOC, UavVisLocOptions
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.retrieval.footprints import cast_footprints
from airzoo_bench.retrieval.truth import read_truth
from tests.datasets.published.uav_visloc_tree import FLIGHTS, anchors, answers, make_tree, read
from tests.support import run_main


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return make_tree(tmp_path / "无人机 UAV VisLoc")


def poses(scene: NativeScene) -> Poses:
    assert scene.poses is not None
    return scene.poses


def footprints(scene: NativeScene) -> Floats:
    """Return lon, lat (N, 4, 2) of the photos' corners on the plane."""
    assert scene.cameras is not None
    assert scene.plane_height_m is not None
    return cast_footprints(
        scene.cameras,
        poses(scene),
        str(scene.crs),
        scene.plane_height_m,
        inset=0.0,
        max_range_m=5000.0,
    ).lonlat


def test_flights_are_found(root: Path, tmp_path: Path) -> None:
    for source in (root, tmp_path):
        assert [*UAV_VISLOC.scenes(UavVisLocOptions(source))] == ["01", "07", "09"]


@pytest.mark.parametrize("flight", FLIGHTS)
def test_footprints_are_those_of_the_ellipsoid(root: Path, flight: str) -> None:
    """Scale of UTM is off by 0.1 % at most, which is 0.3 m at the corner of a footprint."""
    scene = read(root, flight)
    expected = np.stack([anchors(photo) for photo in FLIGHTS[flight].photos])
    assert geodesic_distance_m(footprints(scene), expected).max() < 0.3
    assert scene.names == tuple(FLIGHTS[flight].photo(i) for i in range(len(expected)))


def test_a_footprint_by_hand(root: Path) -> None:
    """At 405 m 52 and 36 degrees see 2 x 197.53 m across and 2 x 131.59 m along.

    Towards 165 degrees the top of the photo is south by east, and its left is east by north: the
    top left corner is 197.53 m towards 75 degrees and 131.59 m towards 165 degrees away, that is
    190.80 + 34.06 = 224.86 m east and 51.12 - 127.11 = -75.99 m north.
    """
    corner = footprints(read(root, "01"))[0, 0]
    lon, lat = FLIGHTS["01"].photos[0][:2]
    east = geodesic_distance_m(np.array([lon, lat]), np.array([corner[0], lat]))
    north = geodesic_distance_m(np.array([lon, lat]), np.array([lon, corner[1]]))
    assert corner[0] > lon
    assert corner[1] < lat
    np.testing.assert_allclose([east, north], [224.86, 75.99], atol=0.1)


def exact(folder: Path) -> dict[str, dict[str, list[str]]]:
    """Return the tiles that answer each photo by the construction of the tree.

    Those with the fewest anchors come first: a footprint turned another way loses them first.
    """
    answered: dict[str, dict[str, list[str]]] = {}
    for scene in sorted((folder / "scenes").iterdir()):
        tiles = pd.read_parquet(scene / "retrieval" / "tiles.parquet").set_index("id")
        sides = tiles[["lon_min", "lat_max", "lon_max", "lat_min"]].to_numpy().tolist()
        boxes = dict(zip(tiles.index, sides, strict=True))
        flight = FLIGHTS[scene.name]
        answered[scene.name] = {
            f"{scene.name}/{Path(flight.photo(i)).stem}": answers(flight, i, boxes)
            for i in range(len(flight.photos))
        }
    return answered


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two flights, one of them on four tiles, made into a benchmark folder."""
    base = tmp_path_factory.mktemp("visloc")
    make_tree(base / "UAV_VisLoc", {name: FLIGHTS[name] for name in ("01", "09")})
    out = base / "data" / "folder"
    assert run_main("prepare", "uav-visloc", "--source", base, "--out", out) == 0
    return out


def test_positives_are_those_of_the_construction(prepared: Path) -> None:
    for scene, queries in exact(prepared).items():
        truth = read_truth(prepared / "scenes" / scene, scene)
        tiles = truth.tiles["id"].to_numpy()
        found = zip(truth.positives.queries, truth.positives.tiles, strict=True)
        pairs = {(truth.queries["id"][query], tiles[tile]) for query, tile in found}
        assert pairs == {(query, tile) for query, ids in queries.items() for tile in ids}
