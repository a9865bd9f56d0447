"""What of a benchmark folder is public where its truth is sealed: an allow list.

Whatever stands in a folder and is not named here is sealed.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path, PurePosixPath

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.manifest import SceneFile
from airzoo_bench.benchmark.queries import CAMERA_COLUMNS, IDENTITY_COLUMNS, PRIOR_COLUMNS
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.raster_files import raster_files
from airzoo_bench.matching.truth import CROP_COLUMNS, own_map
from airzoo_bench.retrieval.truth import BOX_COLUMNS, IMAGE_COLUMNS, POSITION_COLUMNS

__all__ = ["QUERIES", "Kind", "Part", "public_entry", "public_parts", "public_table"]

QUERIES = (*IDENTITY_COLUMNS, *CAMERA_COLUMNS, *PRIOR_COLUMNS)
"""The public columns of ``queries.csv``: what the photos are, and what they say of themselves."""

_GRID = ("x", "y", "width", "height")
_TRANSFORM = (*"abcdef", "crs")
_TILES = (
    *("id", "size_px", "size_m", *_GRID, *BOX_COLUMNS, "valid_share"),
    *IMAGE_COLUMNS[1:],
    *(name for names in POSITION_COLUMNS for name in names),
)
_TABLES = {
    "queries.csv": QUERIES,
    "retrieval/tiles.parquet": _TILES,
    "retrieval/dropped_tiles.csv": _TILES,
    "retrieval/tiles/tiles.csv": ("id", "file", *BOX_COLUMNS, "size_m", *_GRID, *_TRANSFORM),
    "matching/crops.csv": ("id", *CROP_COLUMNS),
    "matching/maps.csv": ("id", "width", "height", *_TRANSFORM, "dsm_sha256"),
    "matching/crops/crops.csv": ("id", "dom_file", "dsm_file", *_GRID, *_TRANSFORM),
    "reconstruction/photos.csv": IDENTITY_COLUMNS,
}
"""By name below a scene's folder, their public columns."""
_FILES = ("matching/map.json",)
_PICTURES = {"retrieval/tiles": (".png",), "matching/crops": ("_dom.tif", "_dsm.tif")}


class Kind(Enum):
    """How a file becomes public."""

    COPY = auto()
    TABLE = auto()
    PHOTO = auto()


@dataclass(frozen=True)
class Part:
    """A public file; of a table, with the columns that are public."""

    kind: Kind
    columns: tuple[str, ...] = ()


_COPY, _PHOTO = Part(Kind.COPY), Part(Kind.PHOTO)


def public_parts(benchmark: Benchmark) -> dict[str, Part]:
    """Name the public files of a benchmark folder, but for benchmark.toml, which is written anew.

    Parameters
    ----------
    benchmark : Benchmark
        With its truth, and all data in the folder.

    Returns
    -------
    dict of str to Part
        By path below the folder.

    Raises
    ------
    BenchmarkError
        Photos, maps or clouds lie outside the folder, or a table is damaged.
    """
    folder = benchmark.folder
    protocols = sorted((folder / "protocols").glob("*.toml"))
    found = {path.relative_to(folder).as_posix(): _COPY for path in protocols}
    for scene in benchmark.file.scenes:
        _refuse_outside(benchmark, scene)
        home = benchmark.scene_folder(scene.id)
        places = [*_of_scene(home), *_data(benchmark, scene, home)]
        found |= {_below(folder, path): part for path, part in places if path.is_file()}
    return found


def public_entry(scene: SceneFile, tracks: Sequence[str]) -> SceneFile:
    """Return what benchmark.toml says of a scene in public."""
    sealed: dict[str, None] = dict.fromkeys(("cloud", "cloud_sha256", "truth_accuracy_m"))
    if "matching" not in tracks:
        sealed |= dict.fromkeys(("dsm", "dsm_sha256", "plane_height_m", "maps"))
    return scene.model_copy(update=sealed)


def public_table(path: Path, columns: Sequence[str]) -> bytes:
    """Return a table with its public columns alone, in the order of its ids."""
    if path.suffix == ".parquet":
        return _public_parquet(path, columns)
    with path.open(encoding="utf-8-sig", newline="") as stream:
        head, *rows = list(csv.reader(stream)) or [[]]
    kept = [place for place, name in enumerate(head) if name in columns]
    if "id" not in head or any(len(row) != len(head) for row in rows):
        raise BenchmarkError("a table without ids, or with rows of other lengths", where=path)
    first = head.index("id")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for row in (head, *sorted(rows, key=lambda row: row[first])):
        writer.writerow([row[place] for place in kept])
    return out.getvalue().encode()


def _public_parquet(path: Path, columns: Sequence[str]) -> bytes:
    import pyarrow.parquet as pq

    table = read_table(path, ("id",))
    said: dict[bytes, bytes] = pq.read_schema(path).metadata or {}
    # Of a table, pandas keeps notes too.
    noted = json.loads(said.get(b"pandas", b"{}")).get("attributes")
    plain = set(said) <= {b"pandas"} and not noted and set(table.columns) <= set(columns)
    if plain and table["id"].is_monotonic_increasing:
        return path.read_bytes()
    public = table[[name for name in table.columns if name in columns]].sort_values("id")
    public.attrs = {}
    out = io.BytesIO()
    public.to_parquet(out, index=False)
    return out.getvalue()


def _of_scene(home: Path) -> Iterator[tuple[Path, Part]]:
    for name, columns in _TABLES.items():
        yield home / name, Part(Kind.TABLE, columns)
    for name in _FILES:
        yield home / name, _COPY
    for name, endings in _PICTURES.items():
        for path in sorted((home / name).rglob("*")):
            if path.name.endswith(endings):
                yield path, _COPY


def _data(benchmark: Benchmark, scene: SceneFile, home: Path) -> Iterator[tuple[Path, Part]]:
    """Yield the photos that there are ids of, and the maps that methods are given."""
    photos = read_table(home / "queries.csv", IDENTITY_COLUMNS)
    for name in photos["image"]:
        yield benchmark.resolve(scene.images) / name, _PHOTO
    given = public_entry(scene, tuple(benchmark.file.tracks))
    for named in (given.dom, given.dsm):
        if named is not None:
            yield from ((path, _COPY) for path in raster_files(benchmark.resolve(named)))
    if given.gallery is not None:
        yield from _gallery(benchmark.resolve(given.gallery), home / "retrieval")
    if given.maps is not None:
        for photo in photos["id"]:
            yield from ((path, _COPY) for path in own_map(benchmark.resolve(given.maps), photo))


def _gallery(gallery: Path, retrieval: Path) -> Iterator[tuple[Path, Part]]:
    if gallery.is_file():
        yield from ((path, _COPY) for path in raster_files(gallery))
        return
    for name in ("tiles.parquet", "dropped_tiles.csv"):
        for image in read_table(retrieval / name, IMAGE_COLUMNS)["image"]:
            yield gallery / image, _PHOTO


def _refuse_outside(benchmark: Benchmark, scene: SceneFile) -> None:
    places = (scene.images, scene.dom, scene.dsm, scene.gallery, scene.maps, scene.cloud)
    for place in (PurePosixPath(one) for one in places if one is not None):
        if place.is_absolute() or ".." in place.parts:
            raise BenchmarkError(
                f"scene {scene.id} has data outside the folder: {place}",
                where=benchmark.folder,
                expected="photos, maps and clouds in the folder, so that it can be given away",
                fix="prepare it again with --copy",
            )


def _below(folder: Path, path: Path) -> str:
    try:
        return path.absolute().relative_to(folder.absolute()).as_posix()
    except ValueError:
        raise BenchmarkError(
            f"a map rests on a file outside the folder: {path}",
            where=folder,
            fix="prepare it again with --copy",
        ) from None
