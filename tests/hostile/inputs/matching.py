"""Predictions of the matching track, what its methods write, and its benchmark folder."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.inputs.case import Input
from tests.hostile.mutations import spoil_arrays, spoil_bytes, spoil_text
from tests.matching import world as matching
from tests.readers import matching_files

__all__ = ["files"]


def files(home: Path) -> list[Input]:
    world = matching.make_world(home)
    ids = [f"{matching.SCENE}/q{q}" for q in range(matching.N_QUERIES)]
    some = [slice(0, 12)] * len(ids)
    query_xy = np.concatenate([xy[s] for xy, s in zip(world.query_xy, some, strict=True)])
    map_xy = np.concatenate([xy[s] for xy, s in zip(world.map_xy, some, strict=True)])
    points = np.concatenate([xyz[s] for xyz, s in zip(world.points, some, strict=True)])
    cameras = world.truth.poses
    matrices = np.concatenate([cameras.rotation, cameras.translation[..., None]], axis=2)
    base: dict[str, Any] = {"protocol": world.protocol.name, "query_ids": ids}
    offsets = {"offsets": np.arange(len(ids) + 1) * 12, "query_xy": query_xy}
    size = np.tile(matching.SIZE, (len(ids), 1))
    given = home / "given"
    given.mkdir()
    np.savez(given / "matches.npz", **base, **offsets, map_xy=map_xy, image_size=size)
    np.savez(given / "crop.npz", **base, **offsets, map_xy=map_xy % 50, map_frame="crop")
    np.savez(given / "pairs.npz", **base, **offsets, points3d=points)
    np.savez(given / "poses.npz", **base, poses=matrices)
    lines = [
        " ".join([name, "0.7071067811865476 0.7071067811865476 0 0", *map(str, t)])
        for name, t in zip(ids, cameras.translation.tolist(), strict=True)
    ]
    (given / "poses.txt").write_text("\n".join(lines))
    read = (("eval", "matching", "FILE"), ("check", "FILE"))
    named = tuple((*c, "--protocol", world.protocol.name) for c in read)
    data = str(home / "data")
    made = [
        Input(f"matching/{name}", given, f"{name}.npz", spoil_arrays, read, data, 0.7)
        for name in ("matches", "crop", "pairs", "poses")
    ]
    made.append(Input("matching/pose text", given, "poses.txt", spoil_text, named, data))
    made += _of_methods(home, world)
    whole = home / "whole"
    shutil.copytree(home / "data", whole / "data")
    shutil.copy(given / "poses.npz", whole)
    sources = home / "sources"
    toml = next((whole / "data").glob("*/benchmark.toml"))
    shutil.copy(sources / "dom.tif", toml.parent / "dom.tif")
    shutil.copy(sources / "dsm.tif", toml.parent / "dsm.tif")
    text = toml.read_text()
    for raster in ("dom.tif", "dsm.tif"):
        text = text.replace(str(sources / raster), raster)
    toml.write_text(text)
    home_of = toml.parent.relative_to(whole).as_posix()
    command = (("eval", "matching", "FOLDER/poses.npz"),)
    for name_, file, spoil in (
        ("queries.csv", f"scenes/{matching.SCENE}/queries.csv", spoil_text),
        ("crops.csv", f"scenes/{matching.SCENE}/matching/crops.csv", spoil_text),
        ("dsm.tif", "dsm.tif", spoil_bytes),
        ("dom.tif", "dom.tif", spoil_bytes),
        ("benchmark.toml", "benchmark.toml", spoil_text),
        ("protocol", f"protocols/{world.protocol.name}.toml", spoil_text),
    ):
        made.append(
            Input(
                f"folder/matching {name_}",
                whole,
                f"{home_of}/{file}",
                spoil,
                command,
                "data",
                0.4,
                checksums=True,
            )
        )
    return made


_METHODS: tuple[tuple[str, Callable[..., Path], Callable[..., bytes]], ...] = (
    ("tum", matching_files.write_tum, spoil_text),
    ("kitti", matching_files.write_kitti, spoil_text),
    ("hloc-poses", matching_files.write_hloc_poses, spoil_text),
    ("hloc", matching_files.write_hloc, spoil_bytes),
    ("hloc", matching_files.write_hloc_dense, spoil_bytes),
    ("loftr", matching_files.write_loftr, spoil_arrays),
    ("superglue", matching_files.write_superglue, spoil_arrays),
    ("roma", matching_files.write_roma, spoil_arrays),
    ("dust3r-matches", matching_files.write_dust3r, spoil_arrays),
    ("mast3r-visloc", matching_files.write_mast3r_visloc, spoil_arrays),
    ("aerialextrematch", matching_files.write_aerialextrematch, spoil_bytes),
    ("colmap-poses", matching_files.write_colmap, spoil_bytes),
    ("vismatch", matching_files.write_vismatch, spoil_bytes),
    ("loftr-dump", matching_files.write_loftr_dump, spoil_bytes),
    ("hloc-logs", matching_files.write_hloc_logs, spoil_bytes),
)


def _of_methods(home: Path, world: matching.World) -> list[Input]:
    """Return what methods of the matching track write, its largest file spoilt."""
    named = ("--protocol", world.protocol.name)
    made = []
    for reader, write, spoil in _METHODS:
        folder = home / "readers" / f"{reader}.{write.__name__}"
        folder.mkdir(parents=True)
        path = write(folder, world)
        files = [one for one in sorted(folder.rglob("*")) if one.is_file()]
        file = max(
            (one for one in files if one.name != "names.txt"), key=lambda one: one.stat().st_size
        )
        given = f"FOLDER/{path.relative_to(folder).as_posix()}"
        listed = ("--names", "FOLDER/names.txt") if (folder / "names.txt").is_file() else ()
        commands = (
            ("eval", "matching", given, *named, "--reader", reader, *listed),
            ("check", given, *named, *listed),
        )
        name = f"readers/{reader} {write.__name__}"
        spoilt_file = file.relative_to(folder).as_posix()
        made.append(Input(name, folder, spoilt_file, spoil, commands, str(home / "data"), 0.3))
    return made
