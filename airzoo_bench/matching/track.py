"""The matching track: a UAV photo is matched to an orthophoto and posed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.parts import EvalOption, Resources
from airzoo_bench.evaluation.query_track import QueryTrack
from airzoo_bench.matching.baseline_settings import SIFT

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.evaluation.evaluate import Evaluation
    from airzoo_bench.matching.predictions import MatchingPredictions, ScenePredictions
    from airzoo_bench.matching.scoring import ScoredScene
    from airzoo_bench.matching.settings import MatchingProtocol
    from airzoo_bench.matching.truth import MatchingTruth
    from airzoo_bench.results.result import Reference
    from airzoo_bench.results.scores import Score

__all__ = ["PRIOR_ITSELF", "TRACK", "MatchingTrack"]

PRIOR_ITSELF = "Prior itself"
"""The reference of every result of the track."""

_MATCHES = 20  # of each query, in a template


def _write_timings(evaluation: Evaluation, path: Path) -> None:
    """Write seconds of the solver for each query, which differ by run."""
    import numpy as np

    from airzoo_bench.core.files import atomic_write
    from airzoo_bench.results.scores import concatenate

    parts = [
        scene.records[["scene", "query"]].assign(
            seconds=np.round([one.seconds for one in scene.estimates], 6)
        )
        for scene in evaluation.scored.values()
    ]
    with atomic_write(path, "w") as stream:
        concatenate(parts).to_csv(stream, index=False, lineterminator="\n")


class MatchingTrack(
    QueryTrack[
        "MatchingProtocol",
        "MatchingPredictions",
        "MatchingTruth",
        "ScenePredictions",
        "ScoredScene",
    ]
):
    """Cross-view matching; see `Track`."""

    name = "matching"
    summary = (
        "Score cross-view matching: translation and pose recall, median error, for each scene."
    )
    kinds = ".npz or .txt"
    suffixes = (".npz", ".txt")
    argument = "An .npz of matches, 2D-3D pairs or poses, or a .txt of poses."
    example = "matches.npz --out results/mymethod --figures"
    options = (
        EvalOption(
            "figures",
            "Draw error curves, matches and maps into --out.",
            "airzoo_bench.report.matching:draw_figures",
            files=r"errors\.png|.+_(map|matches)\.png",
        ),
    )
    takes_image_size = True
    files = {"timings.csv": _write_timings}  # noqa: RUF012 - never changed
    baseline = SIFT

    @property
    def protocol(self) -> type[MatchingProtocol]:
        """See `Track.protocol`."""
        from airzoo_bench.matching.settings import MatchingProtocol

        return MatchingProtocol

    @property
    def recorded(self) -> frozenset[str]:
        """See `Track.recorded`."""
        from airzoo_bench.matching.scoring import RECORDED

        return RECORDED

    def read(self, path: Path, memory_bytes: int) -> MatchingPredictions:
        """See `read_matching`."""
        from airzoo_bench.matching.predictions import read_matching

        return read_matching(path, memory_bytes)

    def read_while_scoring(self, truth: MatchingTruth) -> tuple[Path, ...]:
        """Return the surface models."""
        return tuple(one.dsm for one in truth.maps)

    def validation_errors(
        self, predictions: MatchingPredictions, protocol: MatchingProtocol, *, thorough: bool
    ) -> Iterator[PredictionError]:
        """See `check_file`."""
        from airzoo_bench.matching.checks import check_file

        yield from check_file(predictions)

    def read_truth(self, benchmark: Benchmark, scene: str) -> MatchingTruth:
        """See `truth.read_truth`."""
        from airzoo_bench.matching.truth import read_truth

        return read_truth(benchmark, scene)

    def match_scene(
        self,
        predictions: MatchingPredictions,
        truth: MatchingTruth,
        rows: NDArray[np.intp],
        protocol: MatchingProtocol,
        resources: Resources,
    ) -> ScenePredictions:
        """See `take_scene` and `check_scene`."""
        from airzoo_bench.matching.checks import check_scene
        from airzoo_bench.matching.predictions import take_scene

        predicted = take_scene(predictions, truth, rows)
        try:
            notes = check_scene(predicted, truth, protocol.scores)
        except PredictionError as error:
            raise error.inside(predictions.path) from error
        return replace(predicted, notes=tuple(notes))

    def score(
        self,
        predicted: ScenePredictions,
        truth: MatchingTruth,
        protocol: MatchingProtocol,
        resources: Resources,
    ) -> ScoredScene:
        """See `score_scene`."""
        from airzoo_bench.matching.scoring import score_scene

        return score_scene(truth, predicted, protocol, resources)

    def scores(self, protocol: MatchingProtocol, scored: Sequence[ScoredScene]) -> list[Score]:
        """See `matching_scores`."""
        from airzoo_bench.matching.scoring import matching_scores

        return matching_scores(protocol.scores)

    def kind(self, predictions: MatchingPredictions, scored: Sequence[ScoredScene]) -> str:
        """See `Track.kind`."""
        return predictions.content.kind

    def notes(
        self,
        predictions: MatchingPredictions,
        protocol: MatchingProtocol,
        truths: Sequence[MatchingTruth],
        scene_predictions: Sequence[ScenePredictions],
        scored: Sequence[ScoredScene],
    ) -> list[str]:
        """Return the notes of all scenes."""
        notes = [note for scene in scored for note in scene.notes]
        return [f"scored from {predictions.content.kind}", *notes]

    def inspect(
        self,
        predicted: ScenePredictions,
        truth: MatchingTruth,
        protocol: MatchingProtocol,
        resources: Resources,
    ) -> list[str]:
        """Return the notes of `check_scene`."""
        return list(predicted.notes)

    def inspect_alone(
        self, predictions: MatchingPredictions, protocol: MatchingProtocol, resources: Resources
    ) -> Iterator[PredictionError | str]:
        """See `check_digits`, which `check_scene` calls where the benchmark is there."""
        from airzoo_bench.matching.checks import check_digits
        from airzoo_bench.matching.predictions import GivenPoses

        if isinstance(predictions.content, GivenPoses):
            try:
                finest = protocol.scores.finest_m
                check_digits(predictions.content, predictions.query_ids, finest)
            except PredictionError as error:
                yield error.inside(predictions.path)

    def check_notes(
        self,
        predictions: MatchingPredictions,
        protocol: MatchingProtocol,
        truths: Sequence[MatchingTruth],
        scene_predictions: Sequence[ScenePredictions],
        resources: Resources,
    ) -> list[str]:
        """Return nothing: `inspect` has said it."""
        return []

    def references(
        self, protocol: MatchingProtocol, truths: Sequence[MatchingTruth]
    ) -> dict[str, Reference]:
        """Score the priors as if they were a method's poses; where none are measured, nothing."""
        from airzoo_bench.matching.scoring import matching_scores, score_priors
        from airzoo_bench.results.result import Reference
        from airzoo_bench.results.scores import concatenate, summarise

        if not protocol.prior.is_measured:
            return {}
        records = concatenate([score_priors(truth, protocol.scores) for truth in truths])
        scores, scenes = matching_scores(protocol.scores), [truth.scene for truth in truths]
        floor = Reference(
            meaning="what the photos' own GPS and gimbal angles score, without any matching",
            **asdict(summarise(records, scores, scenes)),
        )
        return {PRIOR_ITSELF: floor}

    def template(
        self,
        protocol: MatchingProtocol,
        truths: Sequence[MatchingTruth],
        kind: str,
        seed: int,
    ) -> dict[str, NDArray[Any]]:
        """Match random pixels of every query to random pixels of its crop."""
        import numpy as np

        random = np.random.default_rng(seed)
        sizes = [np.stack([t.cameras.width, t.cameras.height], axis=1) for t in truths]
        size = np.repeat(np.concatenate(sizes), _MATCHES, axis=0)
        crop = np.repeat(np.concatenate([t.crops for t in truths]), _MATCHES, axis=0)
        ids = np.concatenate([t.queries["id"].to_numpy(str) for t in truths])
        return {
            "query_ids": ids,
            "offsets": np.arange(len(ids) + 1) * _MATCHES,
            "query_xy": random.uniform(0, size),
            "map_xy": crop[:, :2] + random.uniform(0, crop[:, 2:]),
        }


TRACK = MatchingTrack()
