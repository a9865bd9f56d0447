"""The truth of a scene for every track that its data serve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.matching.prepare import build_truth as build_matching_truth
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

__all__ = ["BenchmarkProtocols", "SceneTruths", "build_truths"]


@dataclass(frozen=True)
class BenchmarkProtocols:
    """The protocols of one benchmark, all of the same scenes; None for tracks that it lacks."""

    retrieval: RetrievalProtocol | None = None
    matching: MatchingProtocol | None = None
    reconstruction: ReconstructionProtocol | None = None

    @property
    def every(self) -> tuple[Protocol, ...]:
        """The protocols that are not None."""
        three = (self.retrieval, self.matching, self.reconstruction)
        return tuple(protocol for protocol in three if protocol is not None)


@dataclass(frozen=True, eq=False)
class SceneTruths:
    """The table of a scene's photos and its truth, by track; None where a track has none."""

    photos: pd.DataFrame
    retrieval: PreparedScene | None
    matching: MatchingTruth | None
    reconstruction: ReconstructionTruth | None


def build_truths(
    inputs: SceneInputs,
    protocols: BenchmarkProtocols,
    cloud: Path | None = None,
    reconstructed: pd.Series[bool] | None = None,
) -> SceneTruths:
    """Make the truth of a scene for every track that has a protocol and the data it needs.

    Parameters
    ----------
    inputs : SceneInputs
        Without a prior for any photo there is no truth for matching, unless the protocol takes
        priors from elsewhere.
    protocols : BenchmarkProtocols
    cloud : Path, optional
        The true cloud, in the scene's CRS; without it there is no truth for reconstruction.
    reconstructed : (N,) bool, optional
        Which photos reconstruction may use; by default all.

    Raises
    ------
    UserError
        The map, the surface model or the priors are not as the protocols demand.
    """
    retrieval, matching, reconstruction = None, None, None
    if protocols.retrieval is not None:
        rules = protocols.retrieval.ground_truth
        retrieval = build_retrieval_truth(inputs, protocols.retrieval.gallery, rules)
    if protocols.matching is not None:
        matching = _matching_truth(inputs, protocols.matching)
    if protocols.reconstruction is not None and cloud is not None:
        reconstruction = build_reconstruction_truth(inputs, cloud, reconstructed)
    return SceneTruths(inputs.photos, retrieval, matching, reconstruction)


def _matching_truth(inputs: SceneInputs, protocol: MatchingProtocol) -> MatchingTruth | None:
    if protocol.prior.source == "metadata" and "prior_x" not in inputs.photos.columns:
        return None
    truth = build_matching_truth(inputs, protocol.crop, protocol.prior)
    return None if truth.queries.empty else truth
