"""Benchmark folders: written from scenes and their truth, or completed where made by hand."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import tomli_w
from PIL import Image

from airzoo_bench.benchmark.folder import (
    Benchmark,
    BenchmarkFile,
    SceneFile,
    verify,
    write_benchmark_file,
)
from airzoo_bench.benchmark.images import read_tile
from airzoo_bench.benchmark.queries import write_queries
from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.core.files import atomic_folder, sha256_of
from airzoo_bench.core.progress import with_progress
from airzoo_bench.core.validation import read_toml, validated
from airzoo_bench.datasets.content import SceneContent
from airzoo_bench.datasets.facts import fact_lines
from airzoo_bench.datasets.scene_warnings import scene_warnings
from airzoo_bench.datasets.settings import Prepared, PrepareSettings, SceneSummary, TrackSummary
from airzoo_bench.datasets.truths import BenchmarkProtocols, SceneTruths
from airzoo_bench.evaluation.predictions import read_truth
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_raster,
    pixel_to_world,
    place_source,
    raster_sha256,
    source_elements,
    source_of,
)
from airzoo_bench.matching.truth import photo_maps, write_crop
from airzoo_bench.matching.truth import write_truth as write_matching_truth
from airzoo_bench.protocol.model import Protocol, load_protocol
from airzoo_bench.reconstruction.truth import write_truth as write_reconstruction_truth
from airzoo_bench.retrieval.truth import BOX_COLUMNS
from airzoo_bench.retrieval.truth import write_truth as write_retrieval_truth

_WINDOW = ["x", "y", "width", "height"]


def write_benchmark(
    scenes: Sequence[SceneContent], protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    """Write the benchmark folder, with each protocol that has truth in every scene."""
    summaries = {scene.inputs.scene: summary_of(scene, protocols) for scene in scenes}
    served = served_protocols(protocols, summaries, settings.folder)
    with atomic_folder(settings.folder, replace=settings.replace) as staged:
        entries = [
            write_scene(staged, scene, protocols.titles[scene.inputs.scene], settings)
            for scene in settings.progress(scenes, "writing the folder", len(scenes))
        ]
        write = partial(write_folder_files, staged, served, entries)
        with_progress(write, "checksums", settings.progress)
    return Prepared(settings.folder, {one.name: one.track for one in served}, summaries)


def served_protocols(
    protocols: BenchmarkProtocols, summaries: Mapping[str, SceneSummary], folder: Path
) -> list[Protocol]:
    """Return the protocols that have truth in each of their scenes."""
    served = [
        protocol
        for protocol in protocols.every
        if all(
            protocol.track in summaries[scene.id].tracks
            for scene in protocol.scenes
            if scene.id in summaries
        )
    ]
    if not served:
        why = [
            f"{scene}, {track}: {text}"
            for scene, summary in summaries.items()
            for track, text in summary.without_truth.items()
        ]
        what = f"there is no track that every scene has truth for: {first_of(why)}"
        raise BenchmarkError(what, where=folder, fix="give what is missing")
    return served


def write_scene(
    folder: Path, scene: SceneContent, title: str, settings: PrepareSettings
) -> SceneFile:
    """Write a scene's table of photos, its truth and, where asked for, photos, maps and parts."""
    home, truths, dsm = folder / "scenes" / scene.inputs.scene, scene.truths, scene.inputs.dsm
    truth = truths.reconstruction
    write_queries(home, scene.inputs.photos)
    if truths.retrieval is not None:
        write_retrieval_truth(home, truths.retrieval)
        if settings.tiles_on_disk and not truths.retrieval.has_images:
            _write_tiles(home / "retrieval" / "tiles", scene, settings)
    if truths.matching is not None:
        write_matching_truth(home, truths.matching)
        if settings.crops_on_disk:
            _write_crops(home / "matching" / "crops", truths, settings)
    if truth is not None:
        write_reconstruction_truth(home, truth)
    return SceneFile(
        id=scene.inputs.scene,
        title=title,
        crs=scene.inputs.crs,
        plane_height_m=scene.inputs.plane_height_m,
        dsm_sha256=None if dsm is None else raster_sha256(dsm),
        cloud_sha256=None if truth is None else truth.cloud_sha256,
        truth_accuracy_m=scene.truth_accuracy_m,
        **_places(folder, scene, copy=settings.copy),
    )


def _places(folder: Path, scene: SceneContent, *, copy: bool) -> dict[str, Any]:
    """Return where photos, maps and clouds are, after copying them into the folder if wanted."""
    if not copy:
        return {key: str(path.resolve()) for key, path in scene.files.items()}
    home, places = Path("data") / scene.inputs.scene, {}
    for key, source in scene.files.items():
        of_photos = key in ("images", "maps") or (key == "gallery" and source.is_dir())
        places[key] = home / (key if of_photos else f"{key}{source.suffix.lower()}")
        if of_photos:
            for file in _files_of(scene, key, source):
                _copy(source / file, folder / places[key] / file)
        else:
            (_copy if key == "cloud" else copy_map)(source, folder / places[key])
    return {key: path.as_posix() for key, path in places.items()}


def _files_of(scene: SceneContent, key: str, folder: Path) -> Iterator[str]:
    """Yield the files of a folder that a scene refers to."""
    if key == "gallery" and scene.truths.retrieval is not None:
        yield from scene.truths.retrieval.tiles["image"]
    elif key == "maps":
        pairs = (photo_maps(folder, photo) for photo in scene.inputs.photos["id"])
        there = (path for pair in pairs for path in pair if path.is_file())
        yield from (path.relative_to(folder).as_posix() for path in there)
    else:
        yield from scene.inputs.photos["image"]


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)


def copy_map(source: Path, target: Path) -> None:
    """Copy a raster with the files that it needs: world file, mask, tiles of a virtual raster."""
    with open_raster(source) as dataset:
        files, virtual = [Path(name) for name in dataset.files], dataset.driver == "VRT"
    _copy(source, target)
    for file in files:
        if file != source and file.parent == source.parent and file.stem.startswith(source.stem):
            # Such as dom.tfw or dom.tif.ovr, for a map that becomes dom.tif.
            rest = file.name.removeprefix(source.name)
            ending = target.suffix + rest if rest != file.name else file.suffix
            shutil.copyfile(file, target.with_name(target.stem + ending))
    if virtual:
        _copy_sources(source, target)


def _copy_sources(source: Path, target: Path) -> None:
    tree = ET.parse(source)
    home = target.with_name(f"{target.stem}_tiles")
    home.mkdir()
    copies: dict[Path, str] = {}
    for element in source_elements(tree):
        path = source_of(element, source)
        if path not in copies:
            copies[path] = f"{len(copies):04d}{path.suffix.lower()}"
            copy_map(path, home / copies[path])
        place_source(element, f"{home.name}/{copies[path]}")
    tree.write(target, encoding="utf-8")


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
        title=protocols[0].title.partition(",")[0],
        tracks={protocol.track: protocol.truth_settings() for protocol in protocols},
        scenes=tuple(scenes),
        checksums={},
    )
    write_benchmark_file(folder, file)


def _write_tiles(folder: Path, scene: SceneContent, settings: PrepareSettings) -> None:
    """Write every tile as ``<name>.png``, the name being its id without the scene, and a list."""
    assert scene.truths.retrieval is not None
    tiles, gallery = scene.truths.retrieval.tiles, scene.inputs.gallery_map
    folder.mkdir(parents=True, exist_ok=True)
    files = [f"{_name(tile)}.png" for tile in tiles["id"]]
    rows = zip(files, tiles.iterrows(), strict=True)
    for file, (_, tile) in settings.progress(rows, "tiles", len(tiles)):
        Image.fromarray(read_tile(gallery.path, tile)).save(folder / file)
    listed = tiles[["id", *BOX_COLUMNS, "size_m", *_WINDOW]].copy()
    listed.insert(1, "file", files)
    _write_list(folder / "tiles.csv", listed, [gallery] * len(tiles))


def _write_crops(folder: Path, truths: SceneTruths, settings: PrepareSettings) -> None:
    """Write the crop of each query as ``<name>_dom.tif`` and ``<name>_dsm.tif``, and a list."""
    assert truths.matching is not None
    ids, crops = truths.matching.queries["id"].tolist(), truths.matching.crops
    names, maps = [*map(_name, ids)], [truths.matching.map_of(row) for row in range(len(ids))]
    rows = zip(names, maps, crops.tolist(), strict=True)
    for name, whole, window in settings.progress(rows, "crops", len(ids)):
        write_crop(whole.dom.path, whole.dsm, tuple(window), folder, name)
    files = {f"{kind}_file": [f"{name}_{kind}.tif" for name in names] for kind in ("dom", "dsm")}
    windows = dict(zip(_WINDOW, crops.T, strict=True))
    listed = pd.DataFrame({"id": ids, **files, **windows})
    _write_list(folder / "crops.csv", listed, [one.dom for one in maps])


def _write_list(path: Path, parts: pd.DataFrame, wholes: Sequence[RasterInfo]) -> None:
    """Write a row for each part of its map, with the transform of its pixels to the map's CRS."""
    corners = [
        pixel_to_world(whole.transform, xy)
        for whole, xy in zip(wholes, parts[["x", "y"]].to_numpy(np.float64), strict=True)
    ]
    (a, b, _, d, e, _), (c, f) = (
        np.array(rows, np.float64).reshape(-1, size).T
        for rows, size in (([whole.transform[:6] for whole in wholes], 6), (corners, 2))
    )
    known = {whole.path: whole.crs.to_string() for whole in dict.fromkeys(wholes)}
    crs = [known[whole.path] for whole in wholes]
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = parts.assign(a=a, b=b, c=c, d=d, e=e, f=f, crs=crs)
    columns.to_csv(path, index=False, lineterminator="\n")


def _name(part: str) -> str:
    return part.split("/", 1)[1]


def summary_of(
    scene: SceneContent, protocols: BenchmarkProtocols, notes: Sequence[str] = ()
) -> SceneSummary:
    """Sum up a scene for the user."""
    tracks, facts, photos = _tracks(scene.truths), scene.facts, len(scene.inputs.photos)
    warnings = [] if facts is None else [f"{text} [{code}]" for code, text in scene_warnings(facts)]
    warnings += _count_warnings(scene, protocols, tracks)
    said = list(notes)
    if scene.inputs.unposed:
        unposed = first_of(map(repr, scene.inputs.unposed))
        said.append(f"photos without a pose, which no track asks: {unposed}")
    lines = () if facts is None else tuple(fact_lines(facts))
    missing = scene.truths.missing
    return SceneSummary(photos, lines, tracks, tuple(warnings), tuple(said), missing)


def _tracks(truths: SceneTruths) -> dict[str, TrackSummary]:
    found = {}
    if truths.retrieval is not None:
        truth, counts = truths.retrieval, truths.retrieval.positives.counts
        text = f"{counted(len(truth.queries), 'query')}, {counted(len(truth.tiles), 'tile')}, "
        text += f"{counts.min()} to {counts.max()} positives per query, mean {counts.mean():.1f}"
        found["retrieval"] = TrackSummary(text, len(truth.queries), len(truth.excluded))
    if truths.matching is not None:
        count = len(truths.matching.queries)
        what = ", each with a map of its own" if truths.matching.map_per_query else " with a prior"
        text = f"{counted(count, 'query')}{what}"
        found["matching"] = TrackSummary(text, count, len(truths.matching.excluded))
    if truths.reconstruction is not None:
        count = len(truths.reconstruction.photos)
        found["reconstruction"] = TrackSummary(f"{counted(count, 'photo')}, a true cloud", count)
    return found


def _count_warnings(
    scene: SceneContent, protocols: BenchmarkProtocols, tracks: Mapping[str, TrackSummary]
) -> Iterator[str]:
    """Yield a sentence for each count that is not the published one."""
    name = scene.inputs.scene
    for protocol in protocols.for_scene(name).every:
        published = {one.id: one.queries for one in protocol.scenes}[name]
        found = tracks.get(protocol.track)
        if published is not None and found is not None and found.count != published:
            yield (
                f"scene {name} has {found.count:,} of {published:,} queries that are published for "
                f"{protocol.name}; {counted(len(scene.inputs.photos), 'photo')} have a pose, "
                f"{found.left_out:,} of which are left out (excluded.csv)"
            )
    if scene.gallery_size is not None and scene.truths.retrieval is not None:
        tiles = len(scene.truths.retrieval.tiles)
        if tiles != scene.gallery_size:
            yield (
                f"the gallery of scene {name} has {tiles:,} of {scene.gallery_size:,} published "
                "images: a score over others is another score"
            )


# --- folders made by hand ---


def complete_manifest(folder: Path, *, replace: bool = False) -> list[str]:
    """Write what benchmark.toml lacks: settings of the truth, checksums of files and of data."""
    path = folder / "benchmark.toml"
    values = read_toml(path, BenchmarkError, "benchmark file")
    protocols = [load_protocol(one) for one in sorted((folder / "protocols").glob("*.toml"))]
    if not protocols:
        fix = "copy one of `airzoo-bench protocols NAME`, and set `benchmark` and scenes"
        raise BenchmarkError("has no protocol", where=folder / "protocols", fix=fix)
    name = protocols[0].benchmark
    complete = {"schema": 1, "name": name, "version": 1, "title": name, "checksums": {}}
    complete["tracks"] = {one.track: one.truth_settings() for one in protocols}
    said = [key for key in complete if key not in values]
    file = validated(complete | values, BenchmarkFile, BenchmarkError, path, "benchmark file")
    before, file = file.by_hand, file.model_copy(update={"by_hand": True})
    if file.checksums and not replace:
        with Benchmark(folder, file).fixes():
            verify(folder, file)
    scenes = tuple(_with_checksums(folder, scene, said, replace) for scene in file.scenes)
    file = file.model_copy(update={"scenes": scenes})
    benchmark = Benchmark(folder, file)
    for protocol in protocols:
        benchmark.check_fits(protocol)
        for scene in protocol.scenes:
            _check_truth(benchmark, scene.id, protocol)
    if not said and not replace:
        file = file.model_copy(update={"by_hand": before})
    write_benchmark_file(folder, file)
    return [*said, "checksums of all files below scenes/"]


def _check_truth(benchmark: Benchmark, scene: str, protocol: Protocol) -> None:
    """Read the truth of a scene as `eval` does, and refuse ids that predictions could not name."""
    home = benchmark.scene_folder(scene)
    with benchmark.fixes():
        truth = read_truth(benchmark, protocol, scene)
    for name in ("queries", "tiles"):
        table = getattr(truth, name, None)
        ids = [] if table is None else table["id"].tolist()
        without = [one for one in ids if not one.startswith(f"{scene}/")]
        if without:
            what = f"ids of {name} lack their scene: {first_of(without, len(ids))}"
            expected = f"ids that begin with the scene, such as {scene}/{without[0]}"
            raise BenchmarkError(what, where=home, expected=expected)


def _with_checksums(folder: Path, scene: SceneFile, said: list[str], replace: bool) -> SceneFile:
    found = {}
    for part, sha256 in (("dsm", raster_sha256), ("cloud", sha256_of)):
        place, before = getattr(scene, part), getattr(scene, f"{part}_sha256")
        if place is None or not (folder / place).is_file():
            continue
        now = found[f"{part}_sha256"] = sha256(folder / place)
        if before not in (None, now) and not replace:
            what = f"the {part} of scene {scene.id} was changed since its checksums were written"
            fix = "put it back; or, if the truth is that of the changed file, add --force"
            raise BenchmarkError(what, where=folder / place, fix=fix)
        said += [f"{part}_sha256 of scene {scene.id}"] * (before is None)
    return scene.model_copy(update=found)
