"""The sections of a report: results of one protocol and truth, and places of their queries."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark, needed
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.files import atomic_write, fingerprint, write_npz
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.crs import LONLAT_CRS
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, open_info, read_rgb, to_map_pixels
from airzoo_bench.matching.solving import Status
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.report.figures import COLOURS, Sheet, new_canvas
from airzoo_bench.results.comparison import check_same_queries, choose_scores, same_in_all
from airzoo_bench.results.records import Method, read_records
from airzoo_bench.results.result import Result, ScoreColumn, method_names, read_result, result_paths
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS, boxes_of, scene_truth
from airzoo_bench.tables.breakdown import condition_names

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Window = tuple[int, int, int, int]
Arrays = dict[str, NDArray[Any]]
_KEPT = {"matching": "matches.npz", "reconstruction": "clouds.npz"}
_LIMIT_BYTES = 1 << 30
_LONG_SIDE_PX = 1000
_FAILURES: dict[object, str] = {  # by the status of a query, or by whether it is answered
    False: "no answer",
    Status.MISSING: f"no answer: {Status.MISSING}",
    Status.TOO_FEW_MATCHES: f"no pose: {Status.TOO_FEW_MATCHES} ({{}})",
    **{status: status.value for status in (Status.NO_POSE, Status.NOT_GIVEN)},
}


@dataclass(eq=False)
class Section:
    """Methods of one protocol, truth and set of queries, with records in the same order."""

    methods: list[Method]
    folders: list[Path] = field(default_factory=list)  # of the runs

    @property
    def first(self) -> Result:
        """The first result: protocol and truth are the same in all."""
        return self.methods[0].result

    @property
    def track(self) -> str:
        """Which track."""
        return self.first.track

    @property
    def by_query(self) -> bool:
        """Whether each record is a query, not a scene."""
        return self.first.unit == "query"

    @property
    def names(self) -> list[str]:
        """The names of the methods."""
        return [method.name for method in self.methods]

    @cached_property
    def headline(self) -> list[ScoreColumn]:
        """The headline scores that all methods have; the first one ranks queries."""
        return choose_scores(self.methods, [])

    @cached_property
    def scores(self) -> list[ScoreColumn]:
        """Every score that all methods have."""
        return choose_scores(self.methods, [], every=True)

    @cached_property
    def query_scores(self) -> list[ScoreColumn]:
        """The scores shown for each query: headline scores and errors."""
        return [score for score in self.scores if score.headline or score.unit != "share"]

    @cached_property
    def conditions(self) -> list[str]:
        """Columns of conditions, such as weather, that are the same for all methods."""
        names = condition_names(self.methods[0]) if self.by_query else []
        return [name for name in names if same_in_all(self.methods, name)]

    @cached_property
    def alone(self) -> list[Section]:
        """A section of each method."""
        return [Section([m], self.folders[n : n + 1]) for n, m in enumerate(self.methods)]

    @cached_property
    def failures(self) -> dict[str, str]:
        """Why queries of the first method have no answer or pose; empty where they have."""
        records, nothing = self.methods[0].records, [""] * len(self.methods[0].records)
        status = records.get("status", records.get("answered", nothing))
        rows = zip(records["query"], status, records.get("lifted", nothing), strict=True)
        return {query: _FAILURES.get(one, "").format(lifted) for query, one, lifted in rows}

    def rows_of(self, scene: str) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Return the rows of a scene's records."""
        return np.flatnonzero((self.methods[0].records["scene"] == scene).to_numpy(bool))


def read_sections(paths: Sequence[Path]) -> list[Section]:
    """Read results with their records, and group those that measure the same, the best first."""
    paths = result_paths(paths)
    results = [read_result(path) for path in paths]
    groups: dict[tuple[str, str, str], list[tuple[Path, Method]]] = {}
    for path, name, result in zip(paths, method_names(paths, results), results, strict=True):
        key = (result.track, result.protocol.fingerprint, result.truth.fingerprint)
        scored = Method(name, result, read_records(path, result))
        groups.setdefault(key, []).append((path.parent, scored))
    sections = []
    for members in groups.values():
        methods = [method for _, method in members]
        check_same_queries(methods)
        score = choose_scores(methods, [])[0]
        sign = -1 if score.higher_is_better else 1
        members.sort(key=lambda member: sign * member[1].result.overall[score.key])
        sections.append(Section([m for _, m in members], [folder for folder, _ in members]))
    benchmarks = list(dict.fromkeys(section.first.truth.benchmark for section in sections))
    tracks = [*TRACKS.names(), *(section.track for section in sections)]
    return sorted(
        sections,
        key=lambda one: (benchmarks.index(one.first.truth.benchmark), tracks.index(one.track)),
    )


def keep(out: Path, track: str, arrays: Mapping[str, NDArray[Any]]) -> Path:
    """Write arrays into a run's folder; return the folder of its figures."""
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / _KEPT[track]) as stream:
        write_npz(stream, dict(arrays), compress=True)
    return folder


@lru_cache(maxsize=16)
def read_kept(section: Section) -> Arrays | None:
    """Read what the first method's run has left; None where it has not."""
    paths = [one / "figures" / _KEPT.get(section.track, "") for one in section.folders[:1]]
    files = [NpzFile(path, _LIMIT_BYTES) for path in paths if path.is_file()]
    return {name: files[0].read(name) for name in files[0].names()} if files else None


def need_kept(section: Section) -> Arrays:
    """Read what the first method's run has left, or say how to have it."""
    found = read_kept(section)
    if found is None:
        fix = f"score again with `eval {section.track} ... --out DIR --figures`"
        raise UsageError("this run has left nothing to draw", where=section.folders[0], fix=fix)
    return found


# --- places ---


@dataclass(frozen=True, eq=False)
class Place:
    """A scene with its truth, photos and map, of Q queries as in the records; pixels are the map's.

    Footprints and tiles are outlines of four corners, NaN where they are not known.
    """

    scene: str
    truth: Any  # of the track
    photos: dict[str, Path]  # by the ids of the queries
    dom: RasterInfo | None = None  # the map of the whole scene
    gallery: Path | None = None  # the map of the tiles, or the folder of the images
    outlines: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))  # (Q, 4, 2)
    centres: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # (Q, 2)
    tiles: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))  # (T, 4, 2)
    to_map: Callable[[Floats], Floats] | None = None  # from the scene's CRS to pixels

    def row_of(self, query: str) -> int:
        """Return the row of a query in the arrays of this place."""
        return list(self.photos).index(query)


def find_places(section: Section, data: Path) -> list[Place]:
    """Find the benchmark folder of a section, and read where its queries are."""
    return places_of(section, find_benchmark(section.first.truth.benchmark, data))


def places_of(section: Section, benchmark: Benchmark) -> list[Place]:
    """Read where the queries of a section are; empty for tracks that are not known here."""
    readers = {"retrieval": _retrieval, "matching": _matching, "reconstruction": _reconstruction}
    if section.track not in readers:
        return []
    with benchmark.fixes():
        found = [readers[section.track](benchmark, scene) for scene in section.first.scenes]
    made_with = section.first.truth.fingerprint
    if fingerprint({place.scene: place.truth.fingerprint for place in found}) != made_with:
        raise BenchmarkError(
            "its truth is not the one that the results were made with",
            where=benchmark.folder,
            expected=f"fingerprint {made_with[:12]}",
            fix="name the right benchmark folder with --data, or score again",
        )
    return found


def _retrieval(benchmark: Benchmark, scene: str) -> Place:
    truth, entry = scene_truth(benchmark, scene), benchmark.scene(scene)
    photos = _photos(truth.queries, benchmark, scene)
    if truth.has_images:
        gallery = benchmark.resolve(needed(entry.gallery, "gallery", scene))
        return Place(scene, truth, photos, gallery=gallery)
    dom = open_info(benchmark.resolve(needed(entry.dom, "map", scene)))
    anchors = truth.footprints.reindex(columns=list(ANCHOR_COLUMNS)).to_numpy(np.float64)
    return Place(
        scene,
        truth,
        photos,
        dom,
        benchmark.resolve(entry.gallery) if entry.gallery else dom.path,
        _on_map(dom, anchors.reshape(-1, 4, 2)),
        _on_map(dom, truth.footprint_centres),
        _on_map(dom, boxes_of(truth.tiles)[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]),
    )


def _matching(benchmark: Benchmark, scene: str) -> Place:
    truth = read_matching(benchmark, scene)
    photos = _photos(truth.queries, benchmark, scene)
    if truth.map_per_query:  # there is no map that all queries are on
        return Place(scene, truth, photos)
    dom = truth.maps[0].dom
    to_map = partial(_on_map, dom, crs=benchmark.scene(scene).crs)
    centres = to_map(truth.poses.centres[:, :2])
    unknown = np.full((len(centres), 4, 2), np.nan)
    return Place(scene, truth, photos, dom, outlines=unknown, centres=centres, to_map=to_map)


def _reconstruction(benchmark: Benchmark, scene: str) -> Place:
    truth = read_reconstruction(benchmark, scene)
    return Place(scene, truth, _photos(truth.photos, benchmark, scene))


def _photos(queries: pd.DataFrame, benchmark: Benchmark, scene: str) -> dict[str, Path]:
    folder = benchmark.resolve(benchmark.scene(scene).images)
    return {i: folder / str(n) for i, n in zip(queries["id"], queries["image"], strict=True)}


def _on_map(dom: RasterInfo, places: Floats, crs: Any = LONLAT_CRS) -> Floats:
    """Take places (..., 2) in a CRS, of degrees where none is given, to pixels; NaN stays."""
    flat = places.reshape(-1, 2)
    known = np.isfinite(flat).all(axis=1)
    pixels = np.full(flat.shape, np.nan)
    pixels[known] = to_map_pixels(crs, dom)(flat[known])
    return pixels.reshape(places.shape)


def true_window(place: Place, query: str) -> tuple[RasterInfo, Window] | None:
    """Return the map and the part of it that a query shows; None where that is not known."""
    row = place.row_of(query)
    if hasattr(place.truth, "crops"):
        return place.truth.map_of(row).dom, tuple(place.truth.crops[row].tolist())
    if place.dom is None or not np.isfinite(place.outlines[row]).all():
        return None
    corners = np.clip(place.outlines[row], 0, (place.dom.width, place.dom.height))
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    x, y, width, height = np.concatenate([low, high - low]).astype(int).tolist()
    return (place.dom, (x, y, width, height)) if width and height else None


def jpeg(pixels: NDArray[np.uint8], quality: int = 70) -> bytes:
    """Write a picture (height, width, 3) as JPEG."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality, optimize=True)
    return stream.getvalue()


def draw_ground(place: Place, sheet: Sheet) -> tuple[Figure, Axes, float]:
    """Draw the map of a place; return its figure, axes in metres, and metres per pixel."""
    if place.dom is None:
        raise UsageError(f"scene {place.scene} has no map", expected="queries that share a map")
    wide, high, metres = place.dom.width, place.dom.height, gsd_m(place.dom)[0]
    inches = sheet.wide(7.0)
    figure = new_canvas(inches, inches * min(high / wide, 1.5) * 0.9 + 0.6)
    axes = figure.add_subplot()
    extent = (0.0, wide * metres, high * metres, 0.0)
    axes.imshow(read_rgb(place.dom.path, long_side_px=_LONG_SIDE_PX), extent=extent)
    axes.set(xlabel="metres from the left of the map", ylabel="metres from its top")
    axes.set(xlim=extent[:2], ylim=extent[2:], autoscale_on=False)
    return figure, axes, metres


def mark_failures(section: Section, place: Place, axes: Axes, metres: float) -> Bools:
    """Mark and count the queries without an answer or pose of the first method; return a mask."""
    kinds = np.array([section.failures[query].partition(":")[0] for query in place.photos])
    for kind in np.unique(kinds[kinds != ""]):
        marker, colour = ("s", COLOURS[3]) if kind == "no answer" else ("X", COLOURS[1])
        style: Any = {"color": colour, "markersize": 7, "markeredgecolor": "white"}
        found = place.centres[kinds == kind] * metres
        axes.plot(*found.T, marker, label=f"{kind} ({len(found)})", **style)
    return np.asarray(kinds != "")
