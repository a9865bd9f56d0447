"""UAVScenes: from its own layout to a score, and what is wrong with downloads."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.published.options import UavScenesOptions
from airzoo_bench.datasets.published.reconstructions import published_scenes
from airzoo_bench.datasets.published.uavscenes import UAVSCENES
from tests.datasets.published.bad_uavscenes import SPOILED
from tests.datasets.published.reconstruction_world import local_points, local_poses, score
from tests.datasets.published.uavscenes_tree import make_place, make_run, stamp
from tests.hostile import peak
from tests.support import run_main

PARTIAL, PROTOCOL = "uavscenes-partial", "uavscenes-reconstruction-partial"


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    root = tmp_path / "UAV 场景"
    make_run(root)
    make_place(root)
    return root


def prepare(source: Path, *options: object) -> int:
    given = ("--every", 1) if "--every" not in options else ()
    return run_main("prepare", "uavscenes", "--source", source, *given, *options)


@pytest.mark.parametrize("ground", ["yard", "lot"])
def test_exact_cameras_and_cloud_are_perfect_and_a_shifted_cloud_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ground: str
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    make_run(tmp_path / "source")
    make_place(tmp_path / "source", scene=ground)
    assert prepare(tmp_path / "source") == 0
    poses = local_poses()
    names = [f"{stamp(5 * number)}.jpg" for number in range(len(poses))]

    def scored(shift: float) -> dict[str, Any]:
        points = np.add(local_points(ground), (0.0, 0.0, shift))
        return score(tmp_path / "data", PROTOCOL, "AMtown01", points, names, poses)

    exact = scored(0.0)
    assert exact["f1_1m"] == exact["f1_10m"] == 1.0
    assert exact["pose_auc_3deg"] > 0.999
    assert exact["chamfer_m"] < 1e-3
    assert exact["cameras_missing"] == 0
    shifted = scored(3.0)
    assert shifted["f1_5m"] == shifted["f1_10m"] == 1.0
    if ground == "lot":
        assert shifted["f1_2m"] == 0.0
        assert shifted["chamfer_m"] == pytest.approx(3.0, abs=1e-3)
    assert shifted["f1_2m"] < 0.3


def test_photos_and_poses_are_joined_by_time_stamp(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    home = source / "interval5_CAM_LIDAR" / "interval5_AMtown01" / "interval5_CAM"
    for path in sorted(home.iterdir())[:3]:
        path.rename(path.with_name(path.stem.replace(".", "_") + ".JPG"))
    assert prepare(source) == 0
    table = pd.read_csv(tmp_path / "data" / PARTIAL / "scenes/AMtown01/queries.csv")
    assert len(table) == 6
    assert "surface model" not in capsys.readouterr().err
    stamps = table["id"].str.removeprefix("AMtown01/").str.replace("_", ".")
    found = table.loc[stamps.sort_values().index, ["x", "y", "z"]]
    np.testing.assert_allclose(found.to_numpy(), local_poses().centres, atol=1e-4)
    assert find_benchmark(PARTIAL, tmp_path / "data").scene("AMtown01").crs == "local"


def test_one_photo_in_ten_is_taken_unless_told(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source, "--every", 4) == 0
    said = " ".join("".join(capsys.readouterr()).split())
    assert "one photo in 4 is taken, 2 of 6 (--every)" in said
    table = pd.read_csv(tmp_path / "data" / PARTIAL / "scenes/AMtown01/queries.csv")
    assert table["image"].tolist() == [f"{stamp(0)}.jpg", f"{stamp(20)}.jpg"]
    assert UavScenesOptions(source).every == 10


def test_the_folder_of_a_bundle_or_of_a_run_is_a_source(source: Path) -> None:
    bundle = source / "interval5_CAM_LIDAR"
    for place in (source, bundle, bundle / "interval5_AMtown01"):
        options = UavScenesOptions(place, every=1)
        assert UAVSCENES.scenes(options) == ["AMtown01"]
        read = UAVSCENES.read(options, "AMtown01", silent)
        assert read.cloud is not None
        assert read.cloud.parent.name == "AMtown"
    doubled = source / "more" / "interval5_CAM_LIDAR"
    doubled.mkdir(parents=True)
    shutil.move(bundle, doubled)
    assert UAVSCENES.scenes(UavScenesOptions(source / "more")) == ["AMtown01"]


@pytest.mark.parametrize(
    ("run", "clouds", "taken"),
    [
        ("HKairport01", ("HKairport", "HKisland"), "HKairport"),
        ("HKairport_GNSS02", ("HKairport", "HKairport_GNSS"), "HKairport_GNSS"),
        ("HKairport_GNSS02", ("HKairport", "AMtown"), "HKairport"),
        ("HKisland_GNSS_Evening", ("HKisland_GNSS", "HKisland"), "HKisland_GNSS"),
        ("HKisland_GNSS_Evening", ("HKisland",), "HKisland"),
        ("AMvalley03", ("AMvalley", "AMvalley03"), "AMvalley03"),
    ],
)
def test_the_cloud_is_that_of_the_place(
    tmp_path: Path, run: str, clouds: tuple[str, ...], taken: str
) -> None:
    make_run(tmp_path, run)
    for place in clouds:
        make_place(tmp_path, place)
    read = UAVSCENES.read(UavScenesOptions(tmp_path), run, silent)
    assert read.cloud is not None
    assert read.cloud.parent.name == taken
    said = any("its cloud is taken to be that of" in note for note in read.notes)
    assert said == ("GNSS" in run and "GNSS" not in taken)


def test_the_lens_is_that_of_the_file_or_none(tmp_path: Path) -> None:
    def bend(entries: list[dict[str, Any]]) -> None:
        for entry in entries:
            entry |= {"K1": -0.1, "K2": 0.02, "P1": 1e-3, "P2": 2e-3, "K3": 3e-3}
            entry |= {"Width": 48, "Height": 36}

    make_run(tmp_path, change=bend)
    make_place(tmp_path)
    options = UavScenesOptions(tmp_path)
    read = UAVSCENES.read(options, "AMtown01", silent)
    assert read.cameras is not None
    assert read.cameras.distortion[0].tolist() == [-0.1, 0.02, 1e-3, 2e-3, 3e-3]
    read = UAVSCENES.read(replace(options, lens="none"), "AMtown01", silent)
    assert read.cameras is not None
    assert not read.cameras.distortion.any()


def test_one_pose_may_be_stated_twice(tmp_path: Path) -> None:
    make_run(tmp_path, change=lambda entries: entries.extend(entries[:10]))
    make_place(tmp_path)
    read = UAVSCENES.read(UavScenesOptions(tmp_path, every=1), "AMtown01", silent)
    assert len(read.names) == 6


def test_photos_without_a_pose_are_named(tmp_path: Path) -> None:
    make_run(tmp_path, change=lambda entries: entries.__delitem__(slice(0, 5)))
    make_place(tmp_path)
    read = UAVSCENES.read(UavScenesOptions(tmp_path, every=1), "AMtown01", silent)
    assert read.unposed == (f"{stamp(0)}.jpg",)
    assert len(read.names) == 5


def test_the_protocol_names_twenty_runs() -> None:
    runs = published_scenes("uavscenes")
    assert len(runs) == 20
    assert {run.rstrip("0123456789") for run in runs} == {
        *("AMtown", "AMvalley", "HKairport", "HKairport_GNSS", "HKairport_GNSS_Evening"),
        *("HKisland", "HKisland_GNSS", "HKisland_GNSS_Evening"),
    }


@pytest.mark.parametrize("name", SPOILED)
def test_bad_downloads_have_one_message_and_leave_nothing(
    source: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, said = SPOILED[name]
    spoil(source)
    assert prepare(source) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert " ".join(said.split()) in error
    assert not list(tmp_path.glob("data/*"))


def test_a_cloud_may_be_named(source: Path, tmp_path: Path) -> None:
    other = make_place(tmp_path / "elsewhere")
    for given in (f"AMtown01={other}", str(other)):
        read = UAVSCENES.read(UavScenesOptions(source, cloud=[given]), "AMtown01", silent)
        assert read.cloud == other
    for wrong in (f"AMtown02={other}", "AMtown01=nothing.ply"):
        with pytest.raises(UserError, match="--cloud"):
            UAVSCENES.read(UavScenesOptions(source, cloud=[wrong]), "AMtown01", silent)


def test_a_large_cloud_is_never_in_memory(source: Path, tmp_path: Path) -> None:
    """A cloud of 25 million points, most of them in a hole of the file: 600 MB as float64."""
    cloud = source / "terra_3dmap_pointcloud_mesh/AMtown/cloud_merged.ply"
    count = 25_000_000
    lines = ("ply", "format binary_little_endian 1.0", f"element vertex {count}")
    head = "\n".join((*lines, *(f"property float {axis}" for axis in "xyz"), "end_header\n"))
    cloud.write_bytes(head.encode() + local_points().astype("<f4").tobytes())
    os.truncate(cloud, len(head) + 12 * count)
    given = ("prepare", "uavscenes", "--source", source, "--every", 1)
    ended = peak.run(*given, data=tmp_path / "data")
    assert ended.code == 0, ended.said
    assert ended.peak < 512 << 20
