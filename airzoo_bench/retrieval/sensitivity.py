"""How scores move when values that a truth assumes are off.

The poses and cameras of a benchmark folder are moved within stated ranges, its truth is made again,
and the tiles that results name are scored against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.core.errors import BenchmarkError, ResultError, UsageError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.evaluation.evaluate import truth_fingerprint
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sensitivity import Sensitivity
from airzoo_bench.retrieval.assumptions import AssumedRanges, Variant, moved_queries, variants_of
from airzoo_bench.retrieval.pairs import Positives, hit_matrix
from airzoo_bench.retrieval.prepare import answering_tiles
from airzoo_bench.retrieval.scores import RANKED_TILE, hit_columns
from airzoo_bench.retrieval.settings import (
    GroundTruth,
    ImageScores,
    RetrievalProtocol,
    RetrievalScores,
)
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

__all__ = ["sensitivity"]


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
    rules, settings = _rules(protocol, ranges)
    variants = tuple(variants_of(ranges, draws, seed))
    scores = _rescored(methods[0], settings)
    scenes = tuple(scene.id for scene in protocol.scenes)
    _check_truth(benchmark, scenes, methods)
    shape = (len(scenes), len(methods), len(scores))
    base, values = np.empty(shape), np.empty((len(variants), *shape))
    unanswerable = np.zeros((len(variants), len(scenes)), np.int64)
    for place, scene in enumerate(progress(scenes, "scenes", len(scenes))):
        rescorer = _Rescorer.of(benchmark, scene, methods, scores, rules, settings)
        base[place] = rescorer.values(rescorer.truth.positives)
        for number, variant in enumerate(variants):
            positives = rescorer.positives(variant, seed)
            values[number, place] = rescorer.values(positives)
            unanswerable[number, place] = (positives.counts == 0).sum()
    names = tuple(method.name for method in methods)
    groups = tuple(variant.group for variant in variants)
    return Sensitivity(names, tuple(scores), groups, scenes, base, values, unanswerable)


def _rules(
    protocol: RetrievalProtocol, ranges: AssumedRanges
) -> tuple[GroundTruth, RetrievalScores]:
    if not ranges.given:
        raise UsageError(
            "nothing is assumed to be off",
            expected="a range for at least one value that the truth assumes",
            fix="such as --heading 5 --height 20",
        )
    _, rules = protocol.map_rules()
    if rules.rule not in ("plane", "iou") or isinstance(protocol.scores, ImageScores):
        raise UsageError(
            f"the truth of {protocol.name} is made by the rule {rules.rule!r}",
            expected="rays cast on a plane (rules plane and iou), which the folder alone suffices "
            "to cast again",
        )
    return rules, protocol.scores


def _check_truth(benchmark: Benchmark, scenes: Sequence[str], methods: Sequence[Scored]) -> None:
    """Refuse results on another truth than the folder's: the floors would bear its name."""
    truths = [read_truth(benchmark.scene_folder(scene), scene) for scene in scenes]
    found = truth_fingerprint(truths)
    for method in methods:
        stated = method.result.truth.fingerprint
        if stated != found:
            raise ResultError(
                f"{method.name} was scored on another truth than this folder's "
                f"({stated[:12]} and {found[:12]})",
                where=benchmark.folder,
                expected="results of this benchmark folder",
                fix="score the predictions again with `airzoo-bench eval retrieval ... --out DIR`",
            )


def _rescored(method: Scored, settings: RetrievalScores) -> list[ScoreColumn]:
    """Return the headline scores that the recorded tiles suffice for."""
    depth = max(settings.recall_at)
    deep_enough = {f"recall@{k}" for k in settings.recall_at}
    if settings.ap_at <= depth:
        deep_enough.add(f"ap@{settings.ap_at}")
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
    scores: Sequence[ScoreColumn]
    rules: GroundTruth
    settings: RetrievalScores
    tiles: np.ndarray[tuple[int, ...], np.dtype[np.int32]]

    @classmethod
    def of(
        cls,
        benchmark: Benchmark,
        scene: str,
        methods: Sequence[Scored],
        scores: Sequence[ScoreColumn],
        rules: GroundTruth,
        settings: RetrievalScores,
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
        found = cls(inputs, truth, scores, rules, settings, ranked)
        found._check_made_again()
        return found

    def _check_made_again(self) -> None:
        again = answering_tiles(self.inputs, self.truth.tiles, self.rules)
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
        photos = moved_queries(self.truth.queries, variant, seed)
        moved = replace(self.inputs, photos=photos)
        return answering_tiles(moved, self.truth.tiles, self.rules)

    def values(self, positives: Positives) -> Floats:
        """Score every method, (M, S), over the queries that a tile answers."""
        settings, size = self.settings, len(self.truth.tiles)
        asked: Bools = positives.counts > 0
        if self.rules.without_positive == "miss":
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
