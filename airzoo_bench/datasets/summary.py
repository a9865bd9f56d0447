"""What `prepare` says of a scene: figures, tracks, warnings, and counts against published ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.datasets.dataset import SceneSummary, TrackSummary
from airzoo_bench.datasets.facts_lines import fact_lines, plausibility_warnings
from airzoo_bench.datasets.truths import BenchmarkProtocols, SceneTruths

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.datasets.scene_content import SceneContent
    from airzoo_bench.matching.truth import MatchingTruth
    from airzoo_bench.reconstruction.truth import ReconstructionTruth
    from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["retrieval_summary", "summary_of"]


def summary_of(
    scene: SceneContent, protocols: BenchmarkProtocols, notes: Sequence[str] = ()
) -> SceneSummary:
    """Sum up a scene for the user."""
    tracks, facts = _tracks(scene.truths), scene.facts
    warnings = [] if facts is None else plausibility_warnings(facts)
    warnings += _count_warnings(scene, protocols, tracks)
    if facts is not None and facts.inputs.unposed:
        notes = (
            *notes,
            (
                "photos without a pose, which no track asks: "
                f"{first_of(map(repr, facts.inputs.unposed))}"
            ),
        )
    lines = () if facts is None else tuple(fact_lines(facts))
    return SceneSummary(len(scene.truths.photos), lines, tracks, tuple(warnings), tuple(notes))


def _tracks(truths: SceneTruths) -> dict[str, TrackSummary]:
    found = {}
    if truths.retrieval is not None:
        found["retrieval"] = retrieval_summary(truths.retrieval.truth)
    if truths.matching is not None:
        count = len(truths.matching.queries)
        what = ", each with a map of its own" if truths.matching.own_maps else " with a prior"
        text = f"{counted(count, 'query')}{what}"
        found["matching"] = TrackSummary(text, count, len(truths.matching.excluded))
    if truths.reconstruction is not None:
        count = len(truths.reconstruction.photos)
        found["reconstruction"] = TrackSummary(f"{counted(count, 'photo')}, a true cloud", count)
    return found


def retrieval_summary(truth: RetrievalTruth) -> TrackSummary:
    """Sum up the truth of the retrieval track."""
    counts = truth.positives.counts
    text = f"{counted(len(truth.queries), 'query')}, {counted(len(truth.tiles), 'tile')}, "
    text += f"{counts.min()} to {counts.max()} positives per query, mean {counts.mean():.1f}"
    return TrackSummary(text, len(truth.queries), len(truth.excluded))


def _count_warnings(
    scene: SceneContent, protocols: BenchmarkProtocols, tracks: dict[str, TrackSummary]
) -> Iterator[str]:
    """Yield a sentence for each track whose count is not the published one."""
    for protocol in protocols.every:
        published = {one.id: one.queries for one in protocol.scenes}.get(scene.inputs.scene)
        found = tracks.get(protocol.track)
        if published is None or found is None or found.count == published:
            continue
        less = published - found.count
        yield (
            f"scene {scene.inputs.scene} has {found.count:,} of {published:,} queries that are "
            f"published for {protocol.name} ({abs(less):,} {'missing' if less > 0 else 'too many'})"
            f"; {counted(len(scene.truths.photos), 'photo')} have a pose"
            + _why(_excluded(scene.truths, protocol.track))
        )


def _excluded(truths: SceneTruths, track: str) -> pd.DataFrame:
    if track == "retrieval" and truths.retrieval is not None:
        return truths.retrieval.truth.excluded
    truth: MatchingTruth | ReconstructionTruth = getattr(truths, track)
    return truth.excluded


def _why(excluded: pd.DataFrame) -> str:
    reasons = excluded["reason"].value_counts()
    return "".join(f"; {count:,} left out: {reason}" for reason, count in reasons.items())
