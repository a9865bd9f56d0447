"""``prepare``: mistyped names, other options, poses the wrong way, the real scene."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.results.result import read_result
from airzoo_bench.retrieval.truth import read_truth
from tests.goldens.run import unpack
from tests.support import make_place, run_main


def test_a_mistyped_scene_is_named_and_other_options_or_files_do_not_replace_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    unpack("uav-visloc", tmp_path / "UAV VisLoc")
    source = tmp_path / "UAV VisLoc" / "in"

    def prepare(code: int, *more: object) -> str:
        assert run_main("prepare", "uav-visloc", "--source", source, *more) == code
        return " ".join(capsys.readouterr().err.split())

    assert "(did you mean '07'?)" in prepare(2, "--scene", "7")
    prepare(0, "--scene", "01")
    for more in (["--fov-across", "50"], ["--scene", "07"]):
        said = prepare(2, "--scene", "01", *more)
        assert "data/uav-visloc-partial: " in said
        assert "--force" in said
    (source / "01" / "01.csv").touch()
    assert "--force" in prepare(2, "--scene", "01")
    (source / "09").rename(source.parent / "aside")
    assert f"there is no scene '09' below {source}" in prepare(2, "--scene", "09")
    assert "uav-visloc-partial" in prepare(0, "--force")


def test_camera_to_world_poses_of_oblique_photos_are_noticed(tmp_path, capsys, monkeypatch) -> None:
    # Level, 60 degrees off nadir, to the north from the south of the map; taken the wrong way
    # round it looks to the south, whatever its azimuth was.
    sine, cosine = np.sin(np.radians(60)), np.cos(np.radians(60))
    rotation = np.array([[1, 0, 0], [0, -cosine, -sine], [0, sine, -cosine]])
    place = make_place(tmp_path, {"a.jpg": (128.0, 240.0)})
    place.change_image("a.jpg", R_w2c=rotation.T.tolist())
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main(*place.arguments()) == 2
    message = capsys.readouterr().err
    assert "1 photo: the footprint meets no tile" in message
    assert "whether poses are world-to-camera" in message
    place.change_image("a.jpg", R_w2c=rotation.tolist())
    assert run_main(*place.arguments()) == 0
    assert run_main(*place.arguments(), "--out", tmp_path / "data" / "twin") == 2


@pytest.mark.slow
def test_every_photo_of_the_real_scene_sees_its_own_place_and_its_true_cloud_is_perfect(
    brighton: Path, tmp_path: Path
) -> None:
    out, cloud = tmp_path / "data" / "brighton", tmp_path / "brighton.laz"
    files = {"images": "images", "poses": "poses.json", "dom": "dom_10cm.tif"}
    files |= {"dsm": "dsm_10cm.tif", "cloud": "model.laz"}
    sources = [text for key, file in files.items() for text in (f"--{key}", brighton / file)]
    sizes = ("--tile-size", 256, "--tile-size", 128)
    call = ("prepare", "photos", "--name", "brighton", *sources, *sizes, "--out", out)
    assert run_main(*call) == 0
    home = out / "scenes" / "brighton"
    truth = read_truth(home, "brighton")
    assert len(truth.queries) == 18
    assert truth.excluded.empty
    # About 35 m above the ground plane, nearly nadir.
    assert truth.queries["altitude_m"].between(30, 45).all()
    assert (truth.queries["pitch_deg"] > 80).all()
    # The tile that overlaps the footprint most lies about its middle: tiles have sides of 26 and
    # 13 m, footprints of some 60 and 30.
    with np.load(home / "retrieval" / "overlaps.npz") as overlaps:
        offsets, tiles, ratios = overlaps["offsets"], overlaps["tiles"], overlaps["overlap"]
    best = [tiles[start + ratios[start:stop].argmax()] for start, stop in pairwise(offsets)]
    assert geodesic_distance_m(truth.footprint_centres, truth.tile_centres[best]).max() < 20
    cloud.symlink_to(brighton / "model.laz")
    named = ("--protocol", "brighton-reconstruction", "--data", out.parent)
    assert run_main("eval", "reconstruction", cloud, *named, "--out", tmp_path / "out") == 0
    overall = read_result(tmp_path / "out" / "result.json").overall
    assert overall["f1_1m"] == overall["f1_10m"] == 1.0
