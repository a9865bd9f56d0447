"""How scores move when values that a truth assumes are off.

The poses and cameras of a benchmark folder are moved within stated ranges, its truth is made again,
and the tiles that results name are scored against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.queries import (
    FOCAL_COLUMNS,
    POSE_COLUMNS,
    SIZE_COLUMNS,
    SceneInputs,
    poses_of,
)
from airzoo_bench.core.errors import BenchmarkError, ResultError, UsageError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.geometry.rotations import matrix_to_quaternion
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sensitivity import TOGETHER, Sensitivity
from airzoo_bench.retrieval.pairs import Positives, hit_matrix
from airzoo_bench.retrieval.prepare import answering_tiles
from airzoo_bench.retrieval.scores import RANKED_TILE, hit_columns
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["AssumedRanges", "Variant", "sensitivity"]


@dataclass(frozen=True)
class AssumedRanges:
    """How far the assumed values of a truth may be off, either way; 0 leaves one alone.

    Attributes
    ----------
    field_of_view : float
        Share of the angle, across and along alike.
    heading_deg, height_m : float
        Of all photos of a scene alike: the turn about the vertical, the height above the ground.
    position_m : float
        Standard deviation of the error of each photo's position, east and north, by itself.
    """

    field_of_view: float = 0.0
    heading_deg: float = 0.0
    height_m: float = 0.0
    position_m: float = 0.0

    @property
    def given(self) -> dict[str, float]:
        """The ranges that are not 0, by name."""
        every = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in every.items() if value}


@dataclass(frozen=True)
class Variant:
    """One way in which the assumed values are off.

    Attributes
    ----------
    group : str
        The field of `AssumedRanges` that it is of, or `TOGETHER`.
    by : AssumedRanges
        By how much each value is off; `position_m` is a standard deviation, the others have signs.
    draw : int
        Which of the random draws of positions.
    """

    group: str
    by: AssumedRanges
    draw: int = 0


def sensitivity(
    benchmark: Benchmark,
    protocol: RetrievalProtocol,
    methods: Sequence[Scored],
    ranges: AssumedRanges,
    *,
    draws: int,
    seed: int,
    progress: Progress = silent,
) -> Sensitivity:
    """Make the truth again with assumed values that are off, and score results against it.

    Each value goes to both ends of its range by itself; positions are drawn `draws` times; then
    all are drawn at once, evenly within their ranges, `draws` times.

    Parameters
    ----------
    benchmark : Benchmark
    protocol : RetrievalProtocol
    methods : sequence of Scored
        Results on that truth with records that name the first tiles of each list.
    ranges : AssumedRanges
    draws, seed : int
        Of positions and of all at once.
    progress : Progress

    Raises
    ------
    UserError
        No range is given, the truth does not rest on a plane, cannot be made again from the folder,
        or is not that of the results; records do not name tiles.
    """
    _check(protocol, ranges)
    variants = tuple(_variants(ranges, draws, seed))
    scores = _rescored(methods[0], protocol)
    scenes = tuple(scene.id for scene in protocol.scenes)
    shape = (len(scenes), len(methods), len(scores))
    base, values = np.empty(shape), np.empty((len(variants), *shape))
    unanswerable = np.zeros((len(variants), len(scenes)), np.int64)
    for place, scene in enumerate(progress(scenes, "scenes", len(scenes))):
        rescorer = _Rescorer.of(benchmark, protocol, scene, methods, scores)
        base[place] = rescorer.values(rescorer.truth.positives)
        for number, variant in enumerate(variants):
            positives = rescorer.positives(variant, seed)
            values[number, place] = rescorer.values(positives)
            unanswerable[number, place] = (positives.counts == 0).sum()
    names = tuple(method.name for method in methods)
    groups = tuple(variant.group for variant in variants)
    return Sensitivity(names, tuple(scores), groups, scenes, base, values, unanswerable)


def _check(protocol: RetrievalProtocol, ranges: AssumedRanges) -> None:
    if not ranges.given:
        raise UsageError(
            "nothing is assumed to be off",
            expected="a range for at least one value that the truth assumes",
            fix="such as --heading 5 --height 20",
        )
    if protocol.ground_truth.rule not in ("plane", "iou"):
        raise UsageError(
            f"the truth of {protocol.name} is made by the rule {protocol.ground_truth.rule!r}",
            expected="rays cast on a plane (rules plane and iou), which the folder alone suffices "
            "to cast again",
        )


def _variants(ranges: AssumedRanges, draws: int, seed: int) -> list[Variant]:
    given, none = ranges.given, AssumedRanges()
    found = [
        Variant(name, replace(none, **{name: sign * value}))
        for name, value in given.items()
        if name != "position_m"
        for sign in (-1.0, 1.0)
    ]
    found += [
        Variant("position_m", AssumedRanges(position_m=ranges.position_m), draw)
        for draw in range(draws * bool(ranges.position_m))
    ]
    random = np.random.default_rng(seed)
    for draw in range(draws * (len(given) > 1)):
        off = random.uniform(-1.0, 1.0, 3).tolist()
        by = AssumedRanges(
            ranges.field_of_view * off[0],
            ranges.heading_deg * off[1],
            ranges.height_m * off[2],
            ranges.position_m,
        )
        found.append(Variant(TOGETHER, by, draws + draw))
    return found


def _rescored(method: Scored, protocol: RetrievalProtocol) -> list[ScoreColumn]:
    """Return the headline scores that the recorded tiles suffice for."""
    depth = max(protocol.scores.recall_at)
    deep_enough = {f"recall@{k}" for k in protocol.scores.recall_at}
    if protocol.scores.ap_at <= depth:
        deep_enough.add(f"ap@{protocol.scores.ap_at}")
    return [
        column
        for column in method.result.columns
        if column.headline and column.key.split("/")[0] in deep_enough
    ]


@dataclass(frozen=True, eq=False)
class _Rescorer:
    """A scene's truth, what it was made of, and the first tiles of every method's lists.

    Attributes
    ----------
    tiles : (M, Q, K) int32 array
        Rows of the gallery; -1 where a list has ended.
    """

    inputs: SceneInputs
    truth: RetrievalTruth
    protocol: RetrievalProtocol
    scores: Sequence[ScoreColumn]
    tiles: np.ndarray[tuple[int, ...], np.dtype[np.int32]]

    @classmethod
    def of(
        cls,
        benchmark: Benchmark,
        protocol: RetrievalProtocol,
        scene: str,
        methods: Sequence[Scored],
        scores: Sequence[ScoreColumn],
    ) -> _Rescorer:
        entry = benchmark.scene(scene)
        truth = read_truth(benchmark.scene_folder(scene), scene)
        inputs = SceneInputs(
            scene,
            truth.queries,
            entry.crs,
            open_info(benchmark.resolve(needed(entry.gallery or entry.dom, "map", scene))),
            None,
            entry.plane_height_m,
        )
        ranked = np.stack([_ranked_tiles(method, truth) for method in methods])
        found = cls(inputs, truth, protocol, scores, ranked)
        found._check_made_again()
        return found

    def _check_made_again(self) -> None:
        again = answering_tiles(self.inputs, self.truth.tiles, self.protocol.ground_truth)
        stored = self.truth.positives
        if again.offsets.tolist() != stored.offsets.tolist() or (again.tiles != stored.tiles).any():
            raise BenchmarkError(
                f"the truth of scene {self.inputs.scene} cannot be made again from the poses and "
                "tiles in its folder",
                expected="positives that follow from queries.csv, tiles.parquet and the map",
                fix="prepare the benchmark again with this version",
            )

    def positives(self, variant: Variant, seed: int) -> Positives:
        """Find which tiles answer each query where the assumed values are off."""
        photos = _moved(self.truth.queries, variant, seed)
        moved = replace(self.inputs, photos=photos)
        return answering_tiles(moved, self.truth.tiles, self.protocol.ground_truth)

    def values(self, positives: Positives) -> Floats:
        """Score every method, (M, S), over the queries that a tile answers."""
        settings, size = self.protocol.scores, len(self.truth.tiles)
        asked: Bools = positives.counts > 0
        if self.protocol.ground_truth.without_positive == "miss":
            asked = np.ones_like(asked)
        found = np.zeros((len(self.tiles), len(self.scores)))
        for row, tiles in enumerate(self.tiles):
            hits = hit_matrix(tiles, positives.offsets, positives.tiles, size)
            columns = hit_columns(
                hits,
                positives.counts,
                recall_at=settings.recall_at,
                ap_at={settings.ap_at: (settings.ap,)},
                ndcg_at=(),
            )
            if asked.any():
                found[row] = [columns[score.key][asked].mean() for score in self.scores]
        return found


def _ranked_tiles(
    method: Scored, truth: RetrievalTruth
) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    records = method.records[method.records["scene"] == truth.scene]
    names = [name for name in records.columns if name.startswith(RANKED_TILE)]
    if not names or records["query"].tolist() != truth.queries["id"].tolist():
        raise ResultError(
            f"records of {method.name} do not name the tiles of this truth, scene {truth.scene}",
            expected="results of this benchmark folder, with the columns tile@1, tile@2 ...",
            fix="score the predictions again with `airzoo-bench eval retrieval ... --out DIR`",
        )
    rows = {tile: row for row, tile in enumerate(truth.tiles["id"])}
    listed = records[names].to_numpy(object)
    found = [[rows.get(tile, -1) for tile in tiles] for tiles in listed]
    return np.array(found, np.int32).reshape(len(records), len(names))


def _moved(queries: pd.DataFrame, variant: Variant, seed: int) -> pd.DataFrame:
    """Return the queries with cameras and poses that are off."""
    by, poses = variant.by, poses_of(queries)
    sizes = queries[list(SIZE_COLUMNS)].to_numpy(np.float64)
    focal = queries[list(FOCAL_COLUMNS)].to_numpy(np.float64)
    half = np.arctan(sizes / 2 / focal) * (1.0 + by.field_of_view)
    turn = np.radians(by.heading_deg)
    sine, cosine = np.sin(turn), np.cos(turn)
    # Of the camera, clockwise seen from above: of the world, the other way round.
    clockwise = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    centres = poses.centres + np.array([0.0, 0.0, by.height_m])
    if by.position_m:
        # Queries are sorted by id, so that a photo's error does not depend on the order of files.
        random = np.random.default_rng((seed, variant.draw))
        centres[:, :2] += random.normal(0.0, by.position_m, (len(queries), 2))
    numbers = np.concatenate([matrix_to_quaternion(poses.rotation @ clockwise), centres], axis=1)
    moved = queries.copy()
    moved[list(FOCAL_COLUMNS)] = sizes / 2 / np.tan(half)
    moved[list(POSE_COLUMNS)] = numbers
    return moved
