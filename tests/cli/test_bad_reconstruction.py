"""What bad input gets, through the command: one message and exit code 2, or a stated note."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from tests.cli.bad_reconstruction import FAULTS, Capture
from tests.cli.spoilt_clouds import clouds, cut_laz, lying_ply, with_file, yard
from tests.reconstruction.world import (
    PROTOCOL,
    World,
    camera_poses,
    exact_depth,
    replace_cloud,
    true_points,
)
from tests.support import files_below, run_main


@pytest.mark.parametrize("case", list(FAULTS))
def test_faults(case: str, world: World, tmp_path: Path, capsys: Capture) -> None:
    make, fragments = FAULTS[case]
    path = make(world, tmp_path / "p")
    before = files_below(tmp_path)
    assert run_main("eval", "reconstruction", path, "--out", tmp_path / "out") == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    assert message.count("expected:") <= 1, "more than one message"
    for fragment in fragments:
        assert fragment in message
    # A protocol that is named stands for one that is wrong; 2 is what cannot be read at all.
    if case not in (
        "nothing there",
        "no protocol",
        "another track's protocol",
        "a path as protocol",
    ):
        assert run_main("check", path, "--protocol", PROTOCOL) in (1, 2)
        out, message = capsys.readouterr()
        assert out == ""
        assert "Traceback" not in message
        for fragment in fragments:
            assert fragment in message
    assert files_below(tmp_path) == before


@pytest.mark.parametrize(
    ("name", "fragments"),
    [
        ("p.doc", ["p.doc: no kind of file that predictions come in: '.doc'", "retrieval: .npz"]),
        ("p", ["p: holds no cloud, mesh or npz"]),
        ("nowhere.ply", ["nowhere.ply: "]),
    ],
)
def test_check_of_what_is_no_prediction(
    name: str, fragments: list[str], world: World, tmp_path: Path, capsys: Capture
) -> None:
    (tmp_path / "p").mkdir()
    (tmp_path / "p.doc").write_text("a,b\n")
    assert run_main("check", tmp_path / name) == 2
    message = capsys.readouterr().err
    for fragment in fragments:
        assert fragment in message


def test_check_without_the_benchmark_reads_all(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    """The protocol is shipped, its benchmark folder is not there."""
    path = tmp_path / "p"
    path.mkdir()
    cut_laz(path / "city.laz")
    empty = tmp_path / "empty"
    empty.mkdir()
    arguments = ("--protocol", "airzoo-mini-reconstruction", "--data", empty)
    assert run_main("check", path, *arguments) == 1
    message = capsys.readouterr().err
    assert "city.laz: " in message
    assert "predictions were not compared with the benchmark" in message


def test_an_archive_names_its_files(world: World, tmp_path: Path, capsys: Capture) -> None:
    folder = with_file("yard.laz", cut_laz)(world, tmp_path / "p")
    with zipfile.ZipFile(tmp_path / "p.zip", "w") as archive:
        for file in folder.iterdir():
            archive.write(file, f"p/{file.name}")
    for command in (("eval", "reconstruction"), ("check",)):
        assert run_main(*command, tmp_path / "p.zip") in (1, 2)
        message = capsys.readouterr().err
        assert "p.zip, scene yard, yard.laz: " in message


def test_a_mesh_with_faces_that_name_no_vertex(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    path = with_file("yard.obj", lambda p: p.write_text("v 0 0 0\nv 1 0 0\nf 1 2 9\n"))(
        world, tmp_path / "p"
    )
    assert run_main("eval", "reconstruction", path) == 2
    assert "yard.obj: " in capsys.readouterr().err


def test_fused_maps_that_take_too_many_voxels(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    path = yard()(world, tmp_path / "p")
    chosen = world.protocol(
        tmp_path / "c.toml", fusion={"method": "tsdf", "tsdf_max_voxels": 10_000}
    )
    for command in (("eval", "reconstruction"), ("check",)):
        assert run_main(*command, path, "--protocol", chosen) in (1, 2)
        message = capsys.readouterr().err
        assert "scene yard: the fused surface takes more than 10,000 voxels of 0.5" in message


def test_a_truncation_below_a_voxel(world: World, tmp_path: Path, capsys: Capture) -> None:
    path = yard()(world, tmp_path / "p")
    chosen = tmp_path / "c.toml"
    text = (
        world.protocol(chosen)
        .read_text()
        .replace("tsdf_truncation_m = 2.0", "tsdf_truncation_m = 0.1")
    )
    chosen.write_text(text)
    assert run_main("eval", "reconstruction", path, "--protocol", chosen) == 2
    message = capsys.readouterr().err
    assert "c.toml: key 'fusion': tsdf_truncation_m must be at least tsdf_voxel_m" in message


@pytest.mark.parametrize(
    ("points", "fragments"),
    [
        (np.zeros((0, 3)), ["the true cloud holds no finite point", "check the benchmark's cloud"]),
        (np.full((5, 3), np.nan), ["the true cloud holds no finite point"]),
    ],
)
def test_a_true_cloud_without_points(
    points: Any, fragments: list[str], world: World, tmp_path: Path, capsys: Capture
) -> None:
    path = clouds()(world, tmp_path / "p")
    replace_cloud(world, "yard", points)
    assert run_main("eval", "reconstruction", path) == 2
    message = capsys.readouterr().err
    for fragment in fragments:
        assert fragment in message


def test_a_true_cloud_that_is_gone_or_another(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    path = clouds()(world, tmp_path / "p")
    cloud = world.folder / "data" / "yard" / "cloud.ply"
    write_ply(cloud, Cloud(true_points("yard") + 1.0))
    assert run_main("eval", "reconstruction", path) == 2
    assert "cloud.ply: the cloud is not the one that the benchmark was" in capsys.readouterr().err
    cloud.unlink()
    assert run_main("eval", "reconstruction", path) == 2
    assert "cloud.ply: the true cloud is not there" in capsys.readouterr().err


def test_a_damaged_true_cloud_is_not_blamed_on_the_prediction(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    import tomllib

    import tomli_w

    from airzoo_bench.core.files import sha256_of

    path = clouds()(world, tmp_path / "p")
    cloud, file = world.folder / "data" / "yard" / "cloud.ply", world.folder / "benchmark.toml"
    lying_ply(20_000)(cloud)
    values = tomllib.loads(file.read_text())
    values["scenes"][0]["cloud_sha256"] = sha256_of(cloud)
    file.write_text(tomli_w.dumps(values))
    assert run_main("eval", "reconstruction", path) == 2
    message = capsys.readouterr().err
    assert "cloud.ply: the true cloud cannot be read" in message
    assert f"{path}" not in message


def test_perfect_depth_of_the_made_world_is_exact() -> None:
    """The world's own depth is right: its points lie on the ground or on the box."""
    depth = exact_depth(camera_poses("yard"), boxed=True)
    assert (depth > 20).all()
    assert (depth < 60).all()
