"""`check-geometry` and `check-split` as a person calls them: exit codes, files, messages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import photo_table, write_queries
from tests.support import BRIGHTON, run_main

from .analytic import Flight, orbit, scene, write_depths, write_photos

FLIGHT = orbit(10)


@pytest.fixture
def photos(tmp_path: Path) -> tuple[Path, Path]:
    write_depths(tmp_path / "depth", FLIGHT.depths())
    return write_photos(tmp_path, FLIGHT)


def arguments(photos: tuple[Path, Path], *others: object) -> tuple[object, ...]:
    images, poses = photos
    return ("check-geometry", "--poses", poses, "--images", images, *others)


def write_benchmark(folder: Path, flight: Flight) -> Path:
    made = scene(flight)
    table = photo_table("park", made.images, made.cameras, made.poses, None, 0.0)
    write_queries(folder / "scenes" / "park", table)
    entry = SceneFile(
        id="park",
        title="Park",
        crs="EPSG:4547",
        plane_height_m=0.0,
        images="data/park/images",
        dom="dom.tif",
    )
    file = BenchmarkFile(
        schema=1, name="made", version=1, title="m", tracks={}, scenes=(entry,), checksums={}
    )
    write_benchmark_file(folder, file)
    return folder


def test_exact_photos_pass(photos: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*arguments(photos, "--format", "json")) == 0
    (made,) = json.loads(capsys.readouterr().out)["rows"]
    assert "passes" in str(made)


def test_a_scaled_depth_fails_and_is_named(
    photos: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    path = photos[1].parent / "depth" / "f004.npy"
    np.save(path, np.load(path) * np.float32(0.998))
    assert run_main(*arguments(photos)) == 1
    text = capsys.readouterr().out
    assert "f004.png" in text
    assert "fails" in text


def test_a_benchmark_folder_with_depth_beside_its_photos(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_benchmark(tmp_path / "made", FLIGHT)
    depth = write_depths(folder / "data" / "park" / "depth", FLIGHT.depths())
    assert run_main("check-geometry", folder, "--scene", "park", "--format", "csv") == 0
    assert "passes" in capsys.readouterr().out
    turned = FLIGHT.depths()[::-1]
    write_depths(depth, turned)
    assert run_main("check-geometry", folder) == 1


def test_bad_input_gets_one_message(
    photos: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, poses = photos
    np.save(tmp_path / "depth" / "f002.npy", np.ones((7, 9), np.float32))
    cases: list[tuple[tuple[object, ...], str]] = [
        (arguments(photos), "f002.npy"),
        (arguments(photos, "--depth", tmp_path / "none"), "none"),
        (arguments(photos, "--depth-scale", 0), "--depth-scale"),
        (arguments(photos, "--crs", "EPSG:4326"), "grid"),
        (("check-geometry",), "what is to be checked"),
        (("check-geometry", tmp_path, "--poses", poses), "what is to be checked"),
        (("check-geometry", images), "no benchmark folder here"),
        (("check-split", images, images), "no benchmark folder here"),
        (("check-split", tmp_path / "no.csv", images), "no.csv"),
    ]
    for case, message in cases:
        assert run_main(*case) == 2
        heard = capsys.readouterr()
        assert message in heard.err
        assert "Traceback" not in heard.err


def test_split_names_the_pairs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    here = write_benchmark(tmp_path / "here", FLIGHT)
    away = Flight(FLIGHT.rotation, FLIGHT.centres + np.array((50_000, 0, 0)))
    there = write_benchmark(tmp_path / "there", away)
    assert run_main("check-split", here, there) == 0
    assert "0 pairs" in capsys.readouterr().out
    pairs = tmp_path / "pairs.csv"
    assert run_main("check-split", here, here, "--out", pairs) == 1
    assert "f000" in capsys.readouterr().out
    found = pd.read_csv(pairs)
    assert found["test"].nunique() == len(FLIGHT.centres)
    assert found["train"][0] == "park/f000"


def test_the_real_scene(capsys: pytest.CaptureFixture[str]) -> None:
    if not BRIGHTON.is_dir():
        pytest.skip(f"no real scene at {BRIGHTON}")
    poses, images = BRIGHTON / "poses.json", BRIGHTON / "images"
    options = ("--poses", poses, "--images", images, "--format", "json")
    assert run_main("check-geometry", *options) == 0
    found = json.loads(capsys.readouterr().out)
    [[_, photos, closure_m, *_, verdict]] = found["rows"]
    assert (photos, verdict) == (18, "passes")
    assert float(closure_m) < 1e-6
    assert "depth not checked" in found["notes"][0]


def test_web_mercator_is_no_metres(
    photos: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    images, poses = photos
    file = json.loads(poses.read_text())
    for number, image in enumerate(file["images"].values()):
        image["center"] = [1_800_000.0 + number, 6_070_000.0, 100.0]
    poses.write_text(json.dumps(file | {"crs": "EPSG:3857"}))
    options = ("--poses", poses, "--images", images, "--format", "json")
    assert run_main("check-geometry", *options) == 1
    fault = json.loads(capsys.readouterr().out)["notes"][0]
    assert "EPSG:3857" in fault
    assert "its scale is off by 48." in fault
