"""The truth of a scene for every track that its data serve."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.matching.prepare import build_truth as build_matching_truth
from airzoo_bench.matching.prepare import given_truth
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.truth import build_truth as build_reconstruction_truth
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.prepare import build_truth as build_retrieval_truth
from airzoo_bench.retrieval.settings import RetrievalProtocol

if TYPE_CHECKING:
    import pandas as pd

_BY_POSITION = ("plane", "dsm", "iou")

__all__ = ["BenchmarkProtocols", "SceneTruths", "build_truths"]


@dataclass(frozen=True)
class BenchmarkProtocols:
    """The protocols of one benchmark; None for tracks that it lacks."""

    retrieval: RetrievalProtocol | None = None
    matching: MatchingProtocol | None = None
    reconstruction: ReconstructionProtocol | None = None

    @property
    def every(self) -> tuple[Protocol, ...]:
        """The protocols that are not None."""
        three = (self.retrieval, self.matching, self.reconstruction)
        return tuple(protocol for protocol in three if protocol is not None)

    @property
    def titles(self) -> dict[str, str]:
        """Titles of all scenes, by id."""
        return {scene.id: scene.title for of in self.every for scene in of.scenes}

    def of_scene(self, scene: str) -> BenchmarkProtocols:
        """Leave out the protocols that do not name a scene."""
        named = [any(one.id == scene for one in of.scenes) for of in self.every]
        kept = {of.track: of for of, there in zip(self.every, named, strict=True) if there}
        return BenchmarkProtocols(**kept)  # type: ignore[arg-type]

    def of_scenes(self, scenes: Collection[str]) -> BenchmarkProtocols:
        """Restrict the protocols to some scenes."""
        if all(one.id in scenes for of in self.every for one in of.scenes):
            return self
        kept = {}
        for of in self.every:
            left = tuple(one for one in of.scenes if one.id in scenes)
            names = {"name": f"{of.name}-partial", "benchmark": f"{of.benchmark}-partial"}
            title = f"{of.title} ({len(left)} of {len(of.scenes)} scenes)"[-120:]
            if left:
                kept[of.track] = of.model_copy(update={"scenes": left, "title": title, **names})
        return BenchmarkProtocols(**kept)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class SceneTruths:
    """The table of a scene's photos and its truth, by track; None where a track has none."""

    photos: pd.DataFrame
    retrieval: PreparedScene | None
    matching: MatchingTruth | None
    reconstruction: ReconstructionTruth | None

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks that have truth."""
        three = {
            "retrieval": self.retrieval,
            "matching": self.matching,
            "reconstruction": self.reconstruction,
        }
        return tuple(track for track, truth in three.items() if truth is not None)


def build_truths(
    inputs: SceneInputs,
    protocols: BenchmarkProtocols,
    cloud: Path | None = None,
    reconstructed: pd.Series[bool] | None = None,
) -> SceneTruths:
    """Make the truth of a scene for every track that has a protocol and the data it needs."""
    retrieval, matching, reconstruction = None, None, None
    if protocols.retrieval is not None:
        retrieval = _retrieval_truth(inputs, protocols.retrieval)
    if protocols.matching is not None:
        matching = _matching_truth(inputs, protocols.matching)
    if protocols.reconstruction is not None and cloud is not None:
        reconstruction = build_reconstruction_truth(inputs, cloud, reconstructed)
    return SceneTruths(inputs.photos, retrieval, matching, reconstruction)


def _retrieval_truth(inputs: SceneInputs, protocol: RetrievalProtocol) -> PreparedScene | None:
    gallery, rules = protocol.map_rules()
    if rules.rule in _BY_POSITION and inputs.dom is None and inputs.gallery is None:
        return None
    return build_retrieval_truth(inputs, gallery, rules)


def _matching_truth(inputs: SceneInputs, protocol: MatchingProtocol) -> MatchingTruth | None:
    if protocol.crop is None:
        truth = None if inputs.maps is None else given_truth(inputs, inputs.maps)
        return None if truth is None or truth.queries.empty else truth
    if inputs.dom is None or inputs.dsm is None:
        return None
    if protocol.prior.is_measured and "prior_x" not in inputs.photos.columns:
        return None
    truth = build_matching_truth(inputs, protocol.crop, protocol.prior)
    return None if truth.queries.empty else truth
