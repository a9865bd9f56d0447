"""Writing a benchmark folder out of scenes and their truth, whatever the dataset."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from airzoo_bench.benchmark.images import read_tile
from airzoo_bench.benchmark.manifest import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import write_queries
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import atomic_folder
from airzoo_bench.core.progress import Progress, shown
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.map_copies import copy_map
from airzoo_bench.datasets.scene_content import SceneContent
from airzoo_bench.datasets.summary import summary_of
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world
from airzoo_bench.matching.prepare import write_crop
from airzoo_bench.matching.truth import MatchingTruth, own_map
from airzoo_bench.matching.truth import write_truth as write_matching_truth
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.truth import write_truth as write_reconstruction_truth
from airzoo_bench.retrieval.truth import BOX_COLUMNS
from airzoo_bench.retrieval.truth import write_truth as write_retrieval_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "served_protocols",
    "write_benchmark",
    "write_folder_files",
    "write_scene",
]

_WINDOW = ["x", "y", "width", "height"]


def write_benchmark(
    scenes: Sequence[SceneContent], protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    """Write the benchmark folder, with each protocol that has truth in every scene."""
    truths = {scene.inputs.scene: scene.truths for scene in scenes}
    tracks = {one: truth.tracks for one, truth in truths.items()}
    served = served_protocols(protocols, tracks, settings.folder)
    with atomic_folder(settings.folder, replace=settings.replace) as staged:
        titles = protocols.titles
        entries = [
            write_scene(staged, scene, titles[scene.inputs.scene], settings)
            for scene in settings.progress(scenes, "writing the folder", len(scenes))
        ]
        write = partial(write_folder_files, staged, served, entries)
        shown(write, "checksums", settings.progress)
    return Prepared(
        settings.folder,
        {protocol.name: protocol.track for protocol in served},
        {scene.inputs.scene: summary_of(scene, protocols) for scene in scenes},
        {scene.inputs.scene: scene.facts for scene in scenes if scene.facts is not None},
    )


def served_protocols(
    protocols: BenchmarkProtocols, tracks: Mapping[str, Collection[str]], folder: Path
) -> list[Protocol]:
    """Return the protocols that have truth in each of their scenes."""
    served = [
        protocol
        for protocol in protocols.every
        if all(protocol.track in tracks[one.id] for one in protocol.scenes if one.id in tracks)
    ]
    if not served:
        raise BenchmarkError(
            "there is no track that every scene has truth for",
            where=folder,
            fix="look which scenes lack photos with a prior, a map or a cloud",
        )
    return served


def write_scene(
    folder: Path, scene: SceneContent, title: str, settings: PrepareSettings
) -> SceneFile:
    """Write a scene's table, its truth and, where asked for, its photos and maps."""
    _write_scene(folder / "scenes" / scene.inputs.scene, scene, settings)
    return _entry(scene, title, _places(folder, scene, copy=settings.copy))


def _write_scene(home: Path, scene: SceneContent, settings: PrepareSettings) -> None:
    """Write a scene's table of photos, its truth and, where asked for, tiles and crops."""
    truths, progress = scene.truths, settings.progress
    write_queries(home, truths.photos)
    if truths.retrieval is not None:
        write_retrieval_truth(home, truths.retrieval.truth, truths.retrieval.overlaps)
        if settings.tiles_on_disk:
            tiles, gallery = truths.retrieval.truth.tiles, scene.inputs.gallery_map
            _write_tiles(home / "retrieval" / "tiles", tiles, gallery, progress)
    if truths.matching is not None:
        write_matching_truth(home, truths.matching)
        if settings.crops_on_disk:
            _write_crops(home / "matching" / "crops", truths.matching, progress)
    if truths.reconstruction is not None:
        write_reconstruction_truth(home, truths.reconstruction)


def _entry(scene: SceneContent, title: str, places: Mapping[str, str]) -> SceneFile:
    reconstruction, dsm = scene.truths.reconstruction, scene.inputs.dsm
    return SceneFile(
        id=scene.inputs.scene,
        title=title,
        crs=scene.inputs.crs,
        plane_height_m=scene.inputs.plane_height_m,
        dsm_sha256=None if dsm is None else raster_sha256(dsm),
        cloud_sha256=None if reconstruction is None else reconstruction.cloud_sha256,
        truth_accuracy_m=scene.truth_accuracy_m,
        **places,
    )


def _places(folder: Path, scene: SceneContent, *, copy: bool) -> dict[str, str]:
    """Return where photos, maps and clouds are, after copying them into the folder if wanted."""
    if not copy:
        return {key: str(path.resolve()) for key, path in scene.files.items()}
    home = Path("data") / scene.inputs.scene
    for name in scene.inputs.photos["image"]:
        _copy(scene.files["images"] / name, folder / home / "images" / name)
    kept = {"images": home / "images"}
    if "maps" in scene.files:
        kept["maps"] = home / "maps"
        _copy_own_maps(scene, folder / kept["maps"])
    for key, source in scene.files.items():
        if key not in kept:
            kept[key] = home / f"{key}{source.suffix.lower()}"
            (_copy if key == "cloud" else copy_map)(source, folder / kept[key])
    return {key: path.as_posix() for key, path in kept.items()}


def _copy_own_maps(scene: SceneContent, folder: Path) -> None:
    for photo in scene.inputs.photos["id"]:
        targets = own_map(folder, photo)
        for source, target in zip(own_map(scene.files["maps"], photo), targets, strict=True):
            if source.is_file():
                _copy(source, target)


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)


def write_folder_files(
    folder: Path, protocols: Sequence[Protocol], scenes: Sequence[SceneFile]
) -> None:
    """Write benchmark.toml and the protocols that the truth was made for."""
    (folder / "protocols").mkdir(exist_ok=True)
    for protocol in protocols:
        values = protocol.model_dump(mode="json", by_alias=True, exclude_none=True)
        target = folder / "protocols" / f"{protocol.name}.toml"
        target.write_text(tomli_w.dumps(values), encoding="utf-8")
    file = BenchmarkFile(
        schema=1,
        name=protocols[0].benchmark,
        version=1,
        title=protocols[0].benchmark,
        tracks={protocol.track: protocol.truth_settings() for protocol in protocols},
        scenes=tuple(scenes),
        checksums={},
    )
    write_benchmark_file(folder, file)


def _write_tiles(
    folder: Path, tiles: pd.DataFrame, gallery: RasterInfo, progress: Progress
) -> None:
    """Write every tile as ``<name>.png``, the name being its id without the scene, and a list."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    files = [f"{_name(tile)}.png" for tile in tiles["id"]]
    rows = zip(files, tiles.iterrows(), strict=True)
    for file, (_, tile) in progress(rows, "tiles", len(tiles)):
        Image.fromarray(read_tile(gallery.path, tile)).save(folder / file)
    listed = tiles[["id", *BOX_COLUMNS, "size_m", *_WINDOW]].copy()
    listed.insert(1, "file", files)
    _write_list(folder / "tiles.csv", listed, [gallery] * len(tiles))


def _write_crops(folder: Path, truth: MatchingTruth, progress: Progress) -> None:
    """Write the crop of each query as ``<name>_dom.tif`` and ``<name>_dsm.tif``, and a list."""
    import pandas as pd

    ids = truth.queries["id"].tolist()
    names = [_name(query) for query in ids]
    doms = [truth.map_of(row).dom for row in range(len(ids))]
    for row, name in progress(enumerate(names), "crops", len(ids)):
        of = truth.map_of(row)
        write_crop(of.dom.path, of.dsm, tuple(truth.crops[row].tolist()), folder, name)
    files = {f"{kind}_file": [f"{name}_{kind}.tif" for name in names] for kind in ("dom", "dsm")}
    windows = dict(zip(_WINDOW, truth.crops.T, strict=True))
    _write_list(folder / "crops.csv", pd.DataFrame({"id": ids, **files, **windows}), doms)


def _write_list(path: Path, parts: pd.DataFrame, wholes: Sequence[RasterInfo]) -> None:
    """Write a row for each part of its map, with the transform of its pixels to the map's CRS."""
    places = parts[["x", "y"]].to_numpy(np.float64)
    known = {whole.path: whole.crs.to_string() for whole in dict.fromkeys(wholes)}
    columns = parts.assign(crs=[known[whole.path] for whole in wholes])
    for place, name in enumerate("abcdef"):
        columns.insert(len(columns.columns) - 1, name, [w.transform[place] for w in wholes])
    corners = [pixel_to_world(w.transform, xy) for w, xy in zip(wholes, places, strict=True)]
    columns[["c", "f"]] = np.array(corners, np.float64).reshape(-1, 2)
    path.parent.mkdir(parents=True, exist_ok=True)
    columns.to_csv(path, index=False, lineterminator="\n")


def _name(part: str) -> str:
    return part.split("/", 1)[1]
