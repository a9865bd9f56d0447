"""The truth of a scene, for every track that has a protocol and the data it needs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.matching.prepare import build_truth as build_matching_truth
from airzoo_bench.matching.prepare import given_truth
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.truth import build_truth as build_reconstruction_truth
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.prepare import build_truth as build_retrieval_truth
from airzoo_bench.retrieval.settings import RetrievalProtocol

P = TypeVar("P", bound=Protocol)

_BY_POSITION = ("plane", "dsm", "iou")

__all__ = ["BenchmarkProtocols", "SceneTruths", "build_truths", "variant_of"]


@dataclass(frozen=True)
class BenchmarkProtocols:
    """The protocols of one benchmark; a scene has at most one of each track."""

    every: tuple[Protocol, ...]

    @classmethod
    def named(cls, names: Collection[str], root: Path) -> BenchmarkProtocols:
        """Find protocols by their names or files."""
        return cls(tuple(find_protocol(name, root) for name in names))

    @property
    def benchmark(self) -> str:
        """The benchmark's name."""
        return self.every[0].benchmark

    @property
    def titles(self) -> dict[str, str]:
        """Titles of all scenes, by id."""
        return {scene.id: scene.title for of in self.every for scene in of.scenes}

    @property
    def retrieval(self) -> RetrievalProtocol | None:
        """The first protocol of the retrieval track."""
        return next((one for one in self.every if isinstance(one, RetrievalProtocol)), None)

    @property
    def matching(self) -> MatchingProtocol | None:
        """The first protocol of the matching track."""
        return next((one for one in self.every if isinstance(one, MatchingProtocol)), None)

    @property
    def reconstruction(self) -> ReconstructionProtocol | None:
        """The first protocol of the reconstruction track."""
        return next((one for one in self.every if isinstance(one, ReconstructionProtocol)), None)

    def of_scene(self, scene: str) -> BenchmarkProtocols:
        """Leave out the protocols that do not name a scene."""
        kept = (of for of in self.every if any(one.id == scene for one in of.scenes))
        return BenchmarkProtocols(tuple(kept))

    def of_scenes(self, scenes: Collection[str]) -> BenchmarkProtocols:
        """Restrict the protocols to some scenes, and name them so where that cuts one."""
        kept = []
        for of in self.every:
            left = tuple(one for one in of.scenes if one.id in scenes)
            title = f"{of.title} ({len(left)} of {len(of.scenes)} scenes)"[-120:]
            names = {"name": f"{of.name}-partial", "benchmark": f"{of.benchmark}-partial"}
            if left:
                kept.append((of, {"scenes": left, "title": title, **names}))
        if all(of.scenes == changes["scenes"] for of, changes in kept) and kept:
            whole = len(kept) == len(self.every)
            return self if whole else BenchmarkProtocols(tuple(of for of, _ in kept))
        return BenchmarkProtocols(tuple(of.model_copy(update=changes) for of, changes in kept))


def variant_of(base: P, benchmark: str, changes: dict[str, dict[str, Any]]) -> P:
    """Return a protocol with some values changed; the base itself where its benchmark is that."""
    if benchmark == base.benchmark:
        return base
    values = base.model_dump(by_alias=True)
    added = benchmark.removeprefix(base.benchmark).strip("-").replace("-", " ")
    values |= {"name": f"{benchmark}-{base.track}", "benchmark": benchmark}
    values["title"] = f"{base.title} ({added})"
    for section, keys in changes.items():
        values[section] = values[section] | keys
    return type(base).model_validate(values)


@dataclass(frozen=True, eq=False)
class SceneTruths:
    """The table of a scene's photos and its truth, by track; None where a track has none."""

    photos: pd.DataFrame
    retrieval: PreparedScene | None = None
    matching: MatchingTruth | None = None
    reconstruction: ReconstructionTruth | None = None

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks that have truth."""
        names = ("retrieval", "matching", "reconstruction")
        return tuple(name for name in names if getattr(self, name) is not None)


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
