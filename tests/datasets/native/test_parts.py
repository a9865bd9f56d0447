"""Parts that a scene may lack (map, surface, poses, photos), and what it can then be used for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.facts_lines import fact_lines, plausibility_warnings
from airzoo_bench.datasets.scene_content import scene_content
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.crs import LOCAL_CRS
from tests.datasets.native.flights import NAMES, SCENES, FlightOptions, Flights, everything, prepare
from tests.support import NORTH_WEST, PLACE_CRS, make_place, run_main, write_raster


@pytest.mark.parametrize(
    ("parts", "track"),
    [("dom plane", "retrieval"), ("dom dsm", "retrieval"), ("local cloud", "reconstruction")],
)
def test_a_scene_may_lack_parts(
    flights: Flights, source: Path, data: Path, parts: str, track: str
) -> None:
    for scene in SCENES:
        points = np.random.default_rng(0).uniform(-50, 50, (50, 3))
        points += (NORTH_WEST[0] + 128, NORTH_WEST[1] - 128, 100.0)
        np.save(source / scene / "cloud.npy", points)
    assert prepare(source, "--parts", parts, "--track", track) == 0
    scene = load_benchmark("flights").scene("one")
    assert len(scene.queries() if track == "retrieval" else scene.photos()) == 4
    assert scene.crs == (LOCAL_CRS if "local" in parts else PLACE_CRS)
    assert run_main("check-geometry", data / "flights") == (2 if "local" in parts else 0)


def test_the_plane_gives_what_a_level_surface_gives(
    flights: Flights, source: Path, data: Path
) -> None:
    truths = []
    for parts in ("dom dsm", "dom plane"):
        assert prepare(source, "--parts", parts, "--force") == 0
        truths.append(everything(data / "flights" / "scenes"))
    assert truths[0] == truths[1]


@pytest.mark.parametrize(("parts", "track"), [("dom plane", "matching"), ("local", "retrieval")])
def test_a_track_without_what_it_needs_is_refused(
    flights: Flights,
    source: Path,
    data: Path,
    parts: str,
    track: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert prepare(source, "--parts", parts, "--track", track) == 2
    assert "no track that every scene has truth for" in capsys.readouterr().err
    assert not (data / "flights").exists()


def test_tiles_of_so_many_metres(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "a")
    assert run_main(*place.arguments(tile_size=None, tile_size_m=64)) == 0
    assert "tiles of 64 m are 64 px of the map" in capsys.readouterr().err
    tracks = Benchmark.open(data / "park").file.tracks
    assert tracks["retrieval"]["gallery"]["tile_sizes_px"] == [64]
    for changes in ({"tile_size_m": 64}, {"tile_size": None, "tile_size_m": 0.1}):
        assert run_main(*place.arguments(**changes), "--force") == 2
        assert "--tile-size-m" in capsys.readouterr().err


def test_own_photos_over_a_plane(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "a")
    assert run_main(*place.arguments(dsm=None)) == 2
    assert "--plane-height" in capsys.readouterr().err
    assert run_main(*place.arguments()) == 0
    whole = everything(data / "park" / "scenes" / "park" / "retrieval")
    assert run_main(*place.arguments(dsm=None, plane_height=100), "--force") == 0
    assert "taken as a plane at 100.0 m" in capsys.readouterr().out
    assert everything(data / "park" / "scenes" / "park" / "retrieval") == whole
    assert run_main(*place.arguments(dsm=None, plane_height=100, rule="dsm"), "--force") == 2
    assert "scene park has no surface model" in capsys.readouterr().err


def test_a_surface_model_in_another_crs_is_refused_with_the_command(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "a")
    level = np.full((1, 256, 256), 100, np.float32)
    write_raster(place.dsm, level, crs="EPSG:32634")
    assert run_main(*place.arguments()) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"gdalwarp -t_srs 'EPSG:32633' -r bilinear '{place.dsm}'" in said


def test_photos_without_poses_and_place(flights: Flights, source: Path) -> None:
    read = flights.read(FlightOptions(source, parts=""), "one", silent)
    nowhere = replace(read, cameras=None, poses=None, crs=None)
    content = scene_content(nowhere, BenchmarkProtocols())
    assert list(content.truths.photos) == ["id", "image", "weather"]
    assert content.facts is not None
    assert fact_lines(content.facts) == ["photos          4"]
    assert plausibility_warnings(content.facts) == []
    assert json.dumps(content.facts.values(), allow_nan=False)


def test_a_local_frame_has_no_map(flights: Flights, source: Path) -> None:
    read = flights.read(FlightOptions(source, parts="dom dsm local"), "one", silent)
    with pytest.raises(BenchmarkError, match="in a local frame, and there is a map"):
        scene_content(read, BenchmarkProtocols())


def test_photos_that_are_missing_are_named(flights: Flights, source: Path) -> None:
    (source / "one" / "photos" / NAMES[1]).unlink()
    read = flights.read(FlightOptions(source), "one", silent)
    with pytest.raises(
        BenchmarkError, match=f"photos of scene one are missing: 1 of 4.*{NAMES[1]}"
    ):
        scene_content(read, BenchmarkProtocols())


def test_geometry_of_a_local_scene_needs_depth(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scene in SCENES:
        cloud = np.random.default_rng(0).uniform(0, 200, (500, 3)) - (0, 200, 0)
        np.save(source / scene / "cloud.npy", cloud + np.array((*NORTH_WEST, 0)))
    parts = ("--parts", "local cloud", "--track", "reconstruction")
    assert prepare(source, *parts) == 0
    capsys.readouterr()
    assert run_main("check-geometry", "flights") == 2
    said = capsys.readouterr().err
    assert "nothing can be checked of one: their frame is local, and there is no depth" in said
    assert "--depth" in said
    assert "--crs" not in said
