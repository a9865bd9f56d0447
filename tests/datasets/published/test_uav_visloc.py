"""UAV-VisLoc as it is downloaded: what is read of a flight, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench import evaluate
from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import UavVisLocOptions
from airzoo_bench.datasets.published.uav_visloc import UAV_VISLOC
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.retrieval.footprints import cast_footprints
from airzoo_bench.retrieval.truth import read_truth
from tests.datasets.published.uav_visloc_tree import (
    FLIGHTS,
    along,
    anchors,
    answers,
    make_tree,
    read,
    rewrite,
)
from tests.support import run_main


@pytest.fixture
def root(tmp_path: Path) -> Path:
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
        assert UAV_VISLOC.scenes(UavVisLocOptions(source)) == ["01", "07", "09"]
    assert read(tmp_path, "01").notes == (f"flight 01: the flights are those of {root}",)
    assert len(read(tmp_path, "07").notes) == 1


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


@pytest.mark.parametrize(
    ("options", "phi"),
    [
        ({"heading": "east-north-positive"}, 90.0 - 165.0),
        ({"heading": "counter-clockwise"}, -165.0),
        ({"heading_column": "Phi2"}, 168.0),
    ],
)
def test_headings_by_name(root: Path, options: dict[str, Any], phi: float) -> None:
    expected = anchors((*FLIGHTS["01"].photos[0][:3], phi))
    assert geodesic_distance_m(footprints(read(root, "01", **options))[0], expected).max() < 0.3


def test_fields_of_view_and_plane(root: Path) -> None:
    wide = read(root, "01", fov_across=90.0, plane_height=["205", "7=3"])
    assert wide.plane_height_m == 205.0
    assert poses(wide).centres[0, 2] == 405.0
    corners = footprints(wide)[0]
    across = geodesic_distance_m(corners[0], corners[1])
    np.testing.assert_allclose(across, 400.0, atol=0.2)
    assert read(root, "07", plane_height=["205", "7=3"]).plane_height_m == 3.0


def test_columns_go_by_name(root: Path) -> None:
    before = read(root, "01")
    path = root / "01" / "01.csv"
    lines = [line.split(",") for line in path.read_text().splitlines()]
    mixed = [";".join([*row[::-1], "x"]).replace(".", ",") for row in lines]
    path.write_text("\ufeff" + "\n".join(mixed).replace(",JPG", ".JPG"), encoding="utf-8")
    after = read(root, "01")
    np.testing.assert_array_equal(poses(after).centres, poses(before).centres)
    np.testing.assert_array_equal(poses(after).rotation, poses(before).rotation)


def test_names_in_another_case(root: Path) -> None:
    (root / "01" / "drone" / "01_0002.JPG").rename(root / "01" / "drone" / "01_0002.jpg")
    assert read(root, "01").names[1] == "01_0002.jpg"


def test_no_heading(root: Path) -> None:
    (note,) = read(root, "07").notes
    assert note.startswith(
        "flight 07: 3 of 3 photos have no heading; they got -1.5 degrees (the flight's Phi"
    )
    turned = read(root, "07", missing_heading="88.5")
    expected = anchors((*FLIGHTS["07"].photos[0][:3], 88.5))
    assert geodesic_distance_m(footprints(turned)[0], expected).max() < 0.3
    with pytest.raises(UserError, match="3 of 3 photos have no heading"):
        read(root, "07", missing_heading="leave-out")
    with pytest.raises(UserError, match="'north' is no heading"):
        read(root, "07", missing_heading="north")
    rewrite(root / "01" / "01.csv", ",30.0,", ",,")
    left_out = read(root, "01", missing_heading="leave-out")
    assert left_out.unposed == ("01_0002.JPG",)
    assert left_out.notes == ("flight 01: 1 of 5 photos have no heading and were left out",)


def test_heights_above_the_sea(root: Path) -> None:
    path = root / "01" / "01.csv"
    rewrite(path, ",405.0,", ",2305.0,", 2)
    rewrite(path, ",405.0,", ",2500.0,")
    scene = read(root, "01")
    assert scene.plane_height_m == 2000.0
    assert "heights vary from 2305 to 2500 m" in scene.notes[0]
    assert "--plane-height 01=METRES" in scene.notes[0]
    assert read(root, "01", height_above_ground=400.0).plane_height_m == 2100.0
    assert read(root, "01", plane_height=["1=1900"]).notes == ()
    with pytest.raises(UserError, match="2 of 5 photos were taken at or below the ground"):
        read(root, "01", plane_height=["2305"])
    with pytest.raises(UserError, match="'12=5' is no height"):
        read(root, "01", plane_height=["12=5"])


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


def predictions(path: Path, folder: Path, protocol: str, step: int = 1) -> Path:
    ranked = {query: ids for scene in exact(folder).values() for query, ids in scene.items()}
    rows = [ids[::step][:20] + [""] * (20 - len(ids)) for ids in ranked.values()]
    np.savez(path, protocol=protocol, query_ids=list(ranked), ranked_ids=np.array(rows))
    return path


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


def test_exact_predictions_score_perfect(prepared: Path, tmp_path: Path) -> None:
    (name,) = (path.stem for path in (prepared / "protocols").iterdir())
    path = predictions(tmp_path / "p.npz", prepared, name)
    scores = evaluate(path, data=prepared).overall
    assert {scores[key] for key in ("recall@1", "recall@5", "ap@5")} == {1.0}


@pytest.mark.parametrize("heading", ["east-north-positive", "counter-clockwise"])
def test_a_wrong_heading_scores_lower(prepared: Path, tmp_path: Path, heading: str) -> None:
    wrong = tmp_path / "wrong"
    source = ("--source", prepared.parents[1], "--heading", heading, "--scene", "01")
    assert run_main("prepare", "uav-visloc", *source, "--out", wrong) == 0
    (name,) = (path.stem for path in (wrong / "protocols").iterdir())
    path = predictions(tmp_path / "p.npz", wrong, name)
    assert evaluate(path, data=wrong).overall["ap@5"] < 0.9


def test_a_map_that_is_smaller_than_the_photos(tmp_path: Path) -> None:
    """Flight 07's real map is 170 px high, and its photos 688 m."""
    strip = replace(
        FLIGHTS["07"],
        size=(3000, 170),
        photos=along((115.7953, 40.34477), 688.0, (-1.5,) * 3, 150.0),
    )
    notes = read(make_tree(tmp_path / "tree", {"07": strip}), "07").notes
    assert notes[1].startswith("flight 07: its map is 684 x 51 m, and a photo sees 671 x 447 m")
