"""Every kind of input that the suite reads: a sound one each, and the commands that read it.

To add a kind, append an `Input` to what `made_inputs` returns.
"""

from __future__ import annotations

import gzip
import io
import json
import shutil
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import sha256_of
from tests.formats import cloud_support as clouds
from tests.hostile.mutations import Random, spoil_arrays, spoil_bytes, spoil_e57, spoil_text
from tests.matching import world as matching
from tests.readers import retrieval_support
from tests.readers.samples import (
    aerialextrematch,
    anyloc,
    cloud_trajectory,
    colmap,
    cut3r,
    depth_anything_3,
    dust3r,
    game4loc,
    hloc,
    hloc_global,
    mapanything,
    matchers,
    pickles,
    poses,
    trec,
    university1652,
    vggt,
    vggt_colmap,
    vggt_slam,
    vpr,
)
from tests.reconstruction import world as reconstruction
from tests.support import MadeScene, made_protocol, make_place, run_main, write_benchmark

Spoil = Callable[[Random, bytes], bytes]


@dataclass(frozen=True)
class Input:
    """A kind of input.

    Attributes
    ----------
    name : str
        ``track/what``; failures are named by it.
    folder : Path
        Is copied for every case.
    file : str
        What is spoilt, relative to it.
    spoil : callable
    commands : tuple of tuples
        Arguments, with FOLDER and FILE where those of the case belong; one is drawn.
    data : str or None
        Data root, relative to the folder; None for what needs no benchmark.
    share : float
        How many cases it gets beside others; less where a case takes long.
    checksums : bool
        Put hashes right again that hold the file, in nine of ten cases.
    """

    name: str
    folder: Path
    file: str
    spoil: Spoil
    commands: tuple[tuple[str, ...], ...]
    data: str | None = None
    share: float = 1.0
    checksums: bool = False


def made_inputs(home: Path) -> list[Input]:
    """Make a sound input of every kind below a folder."""
    return [
        *_retrieval(home / "retrieval"),
        *_retrieval_readers(home / "readers"),
        *_matching(home / "matching"),
        *_reconstruction(home / "reconstruction"),
        *_results(home / "results", home / "retrieval"),
        *_tables(home / "tables"),
        *_prepare(home / "prepare"),
    ]


# --- retrieval ---------------------------------------------------------------------------------


def _retrieval(home: Path) -> list[Input]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    scenes = [
        MadeScene("east", [[q, q + 1] for q in range(4)], 6, {"weather": ["rain", "sun"] * 2}),
        MadeScene("west", [[q] for q in range(3)], 5, {"altitude_m": [1.0, 2.0, 3.0]}),
    ]
    chosen = made_protocol(scenes)
    write_benchmark(home / "data" / "made", chosen, scenes)
    ids = [name for scene in scenes for name in scene.query_ids]
    ranked = [scene.tile_ids[:5] for scene in scenes for _ in scene.positives]
    scores = np.tile(np.linspace(1, 0.5, 5), (len(ids), 1))
    name = np.array(chosen.name)
    random = np.random.default_rng(0)
    tiles = [tile for scene in scenes for tile in scene.tile_ids]
    described = {
        "query_descriptors": random.random((len(ids), 3)),
        "gallery_ids": tiles,
        "gallery_descriptors": random.random((len(tiles), 3), np.float32),
    }
    given = home / "given"
    given.mkdir()
    np.savez(given / "ranked.npz", protocol=name, query_ids=ids, ranked_ids=ranked, scores=scores)
    np.savez(given / "described.npz", protocol=name, query_ids=ids, **described)
    columns = {"protocol": [chosen.name] * len(ids), "query_ids": ids, "ranked_ids": ranked}
    columns["scores"] = scores.tolist()
    pq.write_table(pa.table(columns), given / "ranked.parquet")
    pq.write_table(
        pa.table(columns), given / "plain.parquet", use_dictionary=False, row_group_size=3
    )
    read = (("eval", "retrieval", "FILE"), ("check", "FILE"))
    data = str(home / "data")
    made = [
        Input("retrieval/ranked npz", given, "ranked.npz", spoil_arrays, read, data),
        Input("retrieval/descriptors npz", given, "described.npz", spoil_arrays, read, data),
        Input("retrieval/parquet", given, "ranked.parquet", spoil_bytes, read, data),
        Input("retrieval/plain parquet", given, "plain.parquet", spoil_bytes, read, data),
    ]
    whole = home / "whole"
    shutil.copytree(home / "data", whole / "data")
    shutil.copy(given / "ranked.npz", whole)
    command = (("eval", "retrieval", "FOLDER/ranked.npz"), ("protocols",))
    place = "data/made/scenes/east"
    for name_, file, spoil in (
        ("benchmark.toml", "data/made/benchmark.toml", spoil_text),
        ("protocol", f"data/made/protocols/{chosen.name}.toml", spoil_text),
        ("queries.csv", f"{place}/queries.csv", spoil_text),
        ("footprints.csv", f"{place}/retrieval/footprints.csv", spoil_text),
        ("excluded.csv", f"{place}/retrieval/excluded.csv", spoil_text),
        ("positives.npz", f"{place}/retrieval/positives.npz", spoil_arrays),
        ("tiles.parquet", f"{place}/retrieval/tiles.parquet", _spoil_tiles),
    ):
        made.append(
            Input(f"folder/retrieval {name_}", whole, file, spoil, command[:1], "data", 0.7, True)
        )
    return made


def _spoil_tiles(random: Random, content: bytes) -> bytes:
    """Change values and types of a parquet table, or its bytes."""
    import pandas as pd

    if random.random() < 0.4:
        return spoil_bytes(random, content)
    table = pd.read_parquet(io.BytesIO(content))
    name = str(random.choice(table.columns.to_numpy()))
    match int(random.integers(6)):
        case 0:
            table = table.drop(columns=name)
        case 1:
            table[name] = table[name].astype(str).map(lambda text: text.encode() + b"\xff")
        case 2:
            table[name] = table[name].astype(str)
        case 3:
            table[name] = random.choice(np.array([np.nan, 1e308, -1e308, np.inf, -0.0]), len(table))
        case 4:
            table = table.iloc[random.integers(0, len(table), len(table))]
        case _:
            other = str(random.choice(table.columns.to_numpy()))
            table[name] = table[other].to_numpy()
    out = io.BytesIO()
    table.to_parquet(out, index=False)
    return out.getvalue()


# --- matching ----------------------------------------------------------------------------------


def _matching(home: Path) -> list[Input]:
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
    made += _matching_readers(home, world)
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


_MATCHING_READERS: tuple[tuple[str, Callable[..., Path], Callable[..., bytes]], ...] = (
    ("tum", poses.write_tum, spoil_text),
    ("kitti", poses.write_kitti, spoil_text),
    ("hloc-poses", poses.write, spoil_text),
    ("hloc", hloc.write_sparse, spoil_bytes),
    ("hloc", hloc.write_dense, spoil_bytes),
    ("loftr", matchers.write_loftr, spoil_arrays),
    ("superglue", matchers.write_superglue, spoil_arrays),
    ("roma", matchers.write_roma, spoil_arrays),
    ("dust3r-matches", matchers.write_dust3r, spoil_arrays),
    ("mast3r-visloc", matchers.write_mast3r_visloc, spoil_arrays),
    ("aerialextrematch", aerialextrematch.write, spoil_bytes),
    ("colmap-poses", colmap.write_model, spoil_bytes),
    ("vismatch", pickles.write, spoil_bytes),
)


def _matching_readers(home: Path, world: matching.World) -> list[Input]:
    """Return what methods of the matching track write, its largest file spoilt."""
    named = ("--protocol", world.protocol.name)
    made = []
    for reader, write, spoil in _MATCHING_READERS:
        folder = home / "readers" / f"{reader}.{write.__name__}"
        folder.mkdir(parents=True)
        path = write(folder / "files" if write is hloc.write_sparse else folder, world)
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


# --- reconstruction ----------------------------------------------------------------------------


def _reconstruction(home: Path) -> list[Input]:
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
    (given / "mesh.ply").write_bytes(clouds.quads())
    clouds.write_glb(given / "mesh.glb", *clouds.cube_document())
    clouds.write_gltf(given / "text.gltf")
    clouds.write_stl(given / "binary.stl")
    clouds.write_stl_text(given / "ascii.stl")
    (given / "ascii.off").write_text(clouds.OFF_CUBE)
    clouds.write_e57(given / "scan.e57", columns)
    rows = clouds.text_rows(columns)
    (given / "ascii.xyz").write_text(rows)
    (given / "ascii.csv").write_text("x,y,z,r,g,b\n" + clouds.text_rows(columns, ","))
    (given / "ascii.pts").write_text("40\n" + rows)
    np.save(given / "six.npy", np.hstack((clouds.points_of(columns), clouds.colours_of(columns))))
    (given / "packed.ply.gz").write_bytes(gzip.compress((given / "binary.ply").read_bytes()))
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
    made += _native(home / "native", world, data_root)
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


_SPOILS = {".npz": spoil_arrays, ".obj": spoil_text, ".e57": spoil_e57}


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
    for ending, mode in ((".tar", "w"), (".tar.gz", "w:gz")):
        with tarfile.open(packs / f"p{ending}", mode) as tape:  # type: ignore[call-overload]
            for name, source in files.items():
                tape.add(given / source, name)
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


# --- what methods of the retrieval track write ---------------------------------------------------

_READ = (
    (vpr, "vpr", "logs", "logs/east/2026-11-22_19-00-00/database_descriptors.npy", spoil_bytes),
    (vpr, "vpr log", "logs", "logs/east/2026-11-22_19-00-00/info.log", spoil_text),
    (anyloc, "anyloc", "anyloc", "anyloc/east/photos/q00001.jpg.npy", spoil_bytes),
    (hloc_global, "hloc-global", "", "global-feats-netvlad.h5", spoil_bytes),
    (game4loc, "game4loc", "", "features.npz", spoil_arrays),
    (university1652, "university1652", "", "pytorch_result.mat", spoil_bytes),
    (trec, "trec", "", "mine.run", spoil_text),
)


def _retrieval_readers(home: Path) -> list[Input]:
    place = retrieval_support.make_world(home)
    named = ("--protocol", retrieval_support.PROTOCOL)
    made = []
    for sample, name, given, file, spoil in _READ:
        folder = home / name
        folder.mkdir()
        sample.write(folder, place)
        reader = ("--reader", name.split()[0])
        path = f"FOLDER/{given}" if given else "FILE"
        commands = (("eval", "retrieval", path, *named, *reader), ("check", path, *named))
        made.append(
            Input(f"readers/{name}", folder, file, spoil, commands, str(home / "data"), 0.5)
        )
    lists = home / "lists"
    for scene in place.scenes:
        vpr.write_lists(lists / "logs" / scene.id, place, scene)
    command = (("eval", "retrieval", "FOLDER/logs", *named),)
    file = "logs/east/preds/001.txt"
    return [
        *made,
        Input("readers/lists", lists, file, spoil_text, command, str(home / "data"), 0.5),
    ]


def _native(home: Path, world: reconstruction.World, data: str) -> list[Input]:
    """Return what methods write, a file of the yard's spoilt in each."""
    bins = [f"sparse/{name}.bin" for name in ("cameras", "images", "points3D")]
    exported = "exports/mini_npz/results.npz"
    streaming = ("camera_poses.txt", "intrinsic.txt", "results_output/frame_2.npz")
    protocol, made = ("--protocol", reconstruction.PROTOCOL), []
    for reader, write, files in (
        ("vggt", vggt.write_without_pickle, ["predictions.npz"]),
        ("vggt-colmap", vggt_colmap.write, bins),
        ("mapanything", mapanything.write, ["predictions.npz"]),
        ("depth-anything-3", depth_anything_3.write, [exported]),
        ("depth-anything-3", depth_anything_3.write_streaming, streaming),
        ("cut3r", cut3r.write, ["depth/000001.npy", "camera/000000.npz"]),
        ("cut3r", cut3r.write_trajectories, ["pred_traj.txt"]),
        ("dust3r", dust3r.write, ["scene.npz"]),
        ("cloud-trajectory", cloud_trajectory.write, ["trajectory.txt"]),
        ("cloud-trajectory", cloud_trajectory.write_kitti, ["poses.txt"]),
        ("vggt-slam", vggt_slam.write, ["poses.txt", "poses_logs/1.0.npz"]),
    ):
        folder = home / f"{write.__module__}.{write.__name__}"
        write(folder / "out", world)
        given = ("FOLDER/out", "--reader", reader, *protocol)
        commands = (("eval", "reconstruction", *given), ("check", *given))
        for file in files:
            spoils = {".txt": spoil_text, ".bin": spoil_bytes, ".npy": spoil_bytes}
            spoil = spoils.get(Path(file).suffix, spoil_arrays)
            name = f"reconstruction/{reader} {Path(file).name}"
            made.append(Input(name, folder, f"out/yard/{file}", spoil, commands, data, 0.2))
    return made


# --- results, tables, own photos -----------------------------------------------------------------


def _results(home: Path, retrieval: Path) -> list[Input]:
    ranked = retrieval / "given" / "ranked.npz"
    for name in ("mine", "theirs"):
        out = home / name
        data = ("--data", retrieval / "data", "--out", out, "--method", name)
        assert run_main("eval", "retrieval", ranked, *data) == 0
    both = ("FOLDER/mine", "FOLDER/theirs")
    cheap = (
        ("compare", *both, "--resamples", "50"),
        *(("table", *both, "--format", form) for form in ("latex", "csv", "html", "terminal")),
        ("table", *both, "--intervals", "--resamples", "50"),
        ("breakdown", "FOLDER/mine", "--by", "weather"),
    )
    report = (("report", *both, "--out", "FOLDER/r.html"),)
    made = []
    for file, spoil in (("result.json", spoil_text), ("records.csv", spoil_text)):
        made.append(
            Input(f"results/{file}", home, f"mine/{file}", spoil, cheap, None, 0.7, checksums=True)
        )
        made.append(
            Input(f"report/{file}", home, f"mine/{file}", spoil, report, None, 0.2, checksums=True)
        )
    return made


_LONG = "method,scene,metric,value\n" + "".join(
    f"{m},{s},{k},{v}\n"
    for m, v in (("A", "50.31"), ("B", "61.49"))
    for s in ("City", "Rural")
    for k in ("R@1", "R@5")
)
_WIDE = """| Method | R@1 | R@5 | AP@5 |
|---|---|---|---|
| A | 50.31 | 61.49 | 40.0 |
| **B** | 1 | 2 | 3 |
"""
_LATEX = r"""\begin{tabular}{l|cc|cc}
\toprule
\multirow{2}{*}{Method} & \multicolumn{2}{c|}{City (161)} & \multicolumn{2}{c}{Rural (190)} \\
\cmidrule{2-3} & R@1 & R@5 & R@1 & R@5 \\ \midrule
A \cite{a} & 50.31 & \textbf{61.49} & 1.05 & 2.11 \\
B & \underline{51.55} & 60.87 & $2.63_{\pm 0.1}$ & -- \\ \bottomrule
\end{tabular}
"""


def _tables(home: Path) -> list[Input]:
    home.mkdir()
    made = []
    for name, text in (("long.csv", _LONG), ("wide.md", _WIDE), ("paper.tex", _LATEX)):
        (home / name).write_text(text)
        made.append(Input(f"audit/{name}", home, name, spoil_text, (("audit", "FILE"),)))
    return made


def _prepare(home: Path) -> list[Input]:
    home.mkdir()
    make_place(home, {"a.jpg": (64.0, 64.0), "b.jpg": (192.0, 64.0)})
    options = {
        "--name": "park",
        "--images": "FOLDER/photos",
        "--poses": "FOLDER/poses.json",
        "--dom": "FOLDER/dom.tif",
        "--dsm": "FOLDER/dsm.tif",
        "--tile-size": "64",
        "--out": "FOLDER/out",
    }
    command = ("prepare", "photos", *(text for pair in options.items() for text in pair))
    return [
        Input("prepare/poses.json", home, "poses.json", spoil_text, (command,), None, 0.15),
        Input("prepare/photo", home, "photos/a.jpg", spoil_bytes, (command,), None, 0.1),
        Input("prepare/dom.tif", home, "dom.tif", spoil_bytes, (command,), None, 0.1),
        Input("prepare/dsm.tif", home, "dsm.tif", spoil_bytes, (command,), None, 0.1),
    ]


# --- a case --------------------------------------------------------------------------------------


def spoilt(one: Input, random: Random, folder: Path) -> list[str]:
    """Write a case into a folder, and return the arguments of its command."""
    shutil.copytree(one.folder, folder, dirs_exist_ok=True)
    path = folder / one.file
    before = sha256_of(path)
    path.write_bytes(one.spoil(random, path.read_bytes()))
    if one.checksums and random.random() < 0.9:
        _write_checksums(path, before)
    command = one.commands[int(random.integers(len(one.commands)))]
    return [word.replace("FOLDER", str(folder)).replace("FILE", str(path)) for word in command]


def _write_checksums(path: Path, before: str) -> None:
    """Put right what holds a file to its hash, as who made the input by hand would have."""
    after = sha256_of(path)
    for holder in (*path.parents[:6],):
        toml = holder / "benchmark.toml"
        if toml.is_file():
            toml.write_bytes(toml.read_bytes().replace(before.encode(), after.encode()))
            return
    result = path.parent / "result.json"
    if not result.is_file():
        return
    try:
        values = json.loads(result.read_bytes())
    except ValueError:
        return
    if isinstance(values, dict):
        if values.get("records_sha256") == before:
            values["records_sha256"] = after
        result.write_text(json.dumps(_with_checksum(values)))


def _with_checksum(values: dict[str, Any]) -> dict[str, Any]:
    from pydantic import ValidationError

    from airzoo_bench.results.result import Result

    try:
        return json.loads(
            Result.model_validate_json(json.dumps(values))
            .with_checksum()
            .model_dump_json(by_alias=True)
        )
    except (ValidationError, ValueError):
        return values


__all__ = ["Input", "made_inputs", "spoilt"]
