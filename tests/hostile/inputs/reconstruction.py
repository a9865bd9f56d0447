"""Predictions of the reconstruction track, what its methods write, and its benchmark folder."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import numpy as np

from tests.formats import cloud_support as clouds
from tests.formats import test_meshes as meshes
from tests.hostile.inputs.case import Input
from tests.hostile.mutations import spoil_arrays, spoil_bytes, spoil_text
from tests.readers.scene_files import WRITERS
from tests.reconstruction import world as reconstruction

__all__ = ["files"]


def files(home: Path) -> list[Input]:
    world = reconstruction.make_world(home / "data")
    few = np.random.default_rng(0).permutation(len(reconstruction.true_points("yard")))[:60]
    near = reconstruction.true_points("yard")[few]
    for scene in ("yard", "lot"):
        reconstruction.replace_cloud(world, scene, near)
    protocol_file = world.folder / "protocols" / f"{reconstruction.PROTOCOL}.toml"
    text = protocol_file.read_text().replace("points = 2000000", "points = 300")
    protocol_file.write_text(text)
    given = home / "given"
    given.mkdir()
    (given / "protocol.txt").write_text(reconstruction.PROTOCOL)
    columns = clouds.made(40)
    columns |= dict(zip("xyz", near[:40].T, strict=True))
    for name, order in (("ascii", ""), ("binary", "<"), ("big", ">")):
        clouds.write_ply(given / f"{name}.ply", columns, order)
    for data in ("ascii", "binary", "binary_compressed"):
        clouds.write_pcd(given / f"{data}.pcd", columns, data)
    for kind in (0, 3, 7):
        clouds.write_las(given / f"las{kind}.las", columns, kind)
        clouds.write_las(given / f"laz{kind}.laz", columns, kind)
    colours = np.zeros((60, 3), np.uint8)
    np.savez(given / "cloud.npz", points=near, colours=colours, confidence=np.ones(60))
    np.save(given / "cloud.npy", near)
    corners = near[:12]
    faces = "".join(f"f {a} {a + 1} {a + 2}\n" for a in range(1, 10))
    (given / "mesh.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners.tolist()) + faces + "f -1 -2 -3\n"
    )
    quads = {"faces_header": meshes.QUAD_HEADER, "faces": meshes.BINARY_QUADS["<"]}
    clouds.write_ply(given / "mesh.ply", meshes.COLUMNS, **quads)
    meshes.write_glb(given / "mesh.glb", meshes.DOCUMENT)
    coloured = {name: columns[name] for name in ("x", "y", "z", *clouds.COLOURS)}
    rows = clouds.text_rows(coloured)
    (given / "ascii.xyz").write_text(rows)
    (given / "ascii.csv").write_text("x,y,z,r,g,b\n" + clouds.text_rows(coloured, ","))
    (given / "ascii.pts").write_text("40\n" + rows)
    np.save(given / "six.npy", np.stack(list(coloured.values()), axis=-1))
    views = world.views("yard")
    small = views | {"depth": views["depth"][:, ::6, ::6]}
    small["intrinsics"] = views["intrinsics"] * np.array([[1 / 6], [1 / 6], [1.0]])
    maps = {key: value for key, value in small.items() if key != "depth"}
    world_points = np.random.default_rng(0).random((*small["depth"].shape, 3)) * 9
    np.savez(given / "depth.npz", **small, conf=np.ones(small["depth"].shape, np.float32))
    np.savez(given / "points.npz", **maps, world_points=world_points + reconstruction.ORIGIN)
    np.savez(given / "some.cameras.npz", **world.cameras("yard"))
    protocol = ("--protocol", reconstruction.PROTOCOL)
    data_root = str(home / "data")
    made = _entries(home, given, data_root, protocol)
    made += _packs(home, given, data_root)
    made += _of_methods(home / "native", world, data_root)
    whole = home / "whole"
    shutil.copytree(home / "data", whole / "data")
    shutil.copy(given / "binary.ply", whole / "yard.ply")
    command = (("eval", "reconstruction", "FOLDER/yard.ply", *protocol),)
    base = f"data/{reconstruction.NAME}"
    for file, spoil in (
        (f"{base}/data/yard/cloud.ply", spoil_bytes),
        (f"{base}/scenes/yard/queries.csv", spoil_text),
        (f"{base}/scenes/yard/reconstruction/photos.csv", spoil_text),
        (f"{base}/protocols/{reconstruction.PROTOCOL}.toml", spoil_text),
    ):
        name = f"folder/reconstruction {Path(file).name}"
        made.append(Input(name, whole, file, spoil, command, "data", 0.3, checksums=True))
    return made


_SPOILS = {".npz": spoil_arrays, ".obj": spoil_text}


def _entries(home: Path, given: Path, data: str, protocol: tuple[str, str]) -> list[Input]:
    """Each file alone in a folder, named by its scene."""
    commands = (("eval", "reconstruction", "FILE", *protocol), ("check", "FILE", *protocol))
    made = []
    for path in sorted(given.iterdir()):
        if path.name in ("protocol.txt", "some.cameras.npz"):
            continue
        one = home / "entries" / path.name
        one.mkdir(parents=True)
        ending = path.name[path.name.index(".") :]
        shutil.copy(path, one / f"yard{ending}")
        spoil = _SPOILS.get(path.suffix, spoil_bytes)
        if "ascii" in path.name:
            spoil = spoil_text
        name = f"reconstruction/{path.name}"
        made.append(Input(name, one, f"yard{ending}", spoil, commands, data, 0.4))
    return made


def _packs(home: Path, given: Path, data: str) -> list[Input]:
    packs = home / "packs"
    packs.mkdir()
    files = {"protocol.txt": "protocol.txt", "yard.ply": "binary.ply"}
    files["yard.cameras.npz"] = "some.cameras.npz"
    with zipfile.ZipFile(packs / "p.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, source in files.items():
            archive.write(given / source, name)
    read = (("eval", "reconstruction", "FILE"), ("check", "FILE"))
    made = [
        Input(f"reconstruction/{path.name}", packs, path.name, spoil_bytes, read, data, 0.5)
        for path in sorted(packs.iterdir())
    ]
    loose = home / "loose"
    loose.mkdir()
    for name, source in files.items():
        shutil.copy(given / source, loose / name)
    folder = tuple((*command[:-1], "FOLDER") for command in read)
    for file, spoil in (("yard.cameras.npz", spoil_arrays), ("protocol.txt", spoil_text)):
        made.append(Input(f"reconstruction/{file}", loose, file, spoil, folder, data, 0.4))
    return made


def _of_methods(home: Path, world: reconstruction.World, data: str) -> list[Input]:
    """Return what methods write, a file of the yard's spoilt in each."""
    bins = [f"sparse/{name}.bin" for name in ("cameras", "images", "points3D")]
    exported = "exports/mini_npz/results.npz"
    streaming = ("camera_poses.txt", "intrinsic.txt", "results_output/frame_2.npz")
    protocol, made = ("--protocol", reconstruction.PROTOCOL), []
    for layout, files, options in (
        ("vggt", ["predictions.npz"], {"pose_enc_list": None}),
        ("vggt_colmap", bins, {}),
        ("mapanything", ["predictions.npz"], {}),
        ("da3", [exported], {}),
        ("da3_streaming", streaming, {}),
        ("cut3r", ["depth/000001.npy", "camera/000000.npz"], {}),
        ("cut3r_trajectory", ["pred_traj.txt"], {}),
        ("dust3r", ["scene.npz"], {}),
        ("cloud_trajectory", ["trajectory.txt", "map.ply"], {}),
        ("cloud_trajectory", ["poses.txt"], {"kitti": True}),
        ("vggt_slam", ["poses.txt", "poses_logs/1.0.npz"], {}),
    ):
        folder = home / f"{layout}{len(made)}"
        WRITERS[layout](folder, world, **options)
        readers = {"cut3r_trajectory": "cut3r", "da3_streaming": "depth-anything-3"}
        readers["da3"] = "depth-anything-3"
        reader = readers.get(layout, layout.replace("_", "-"))
        given = ("FOLDER/out", "--reader", reader, *protocol)
        commands = (("eval", "reconstruction", *given), ("check", *given))
        for file in files:
            spoil = {".txt": spoil_text, ".npz": spoil_arrays}.get(Path(file).suffix, spoil_bytes)
            name = f"reconstruction/{reader} {Path(file).name}"
            made.append(Input(name, folder, f"out/yard/{file}", spoil, commands, data, 0.2))
    return made
