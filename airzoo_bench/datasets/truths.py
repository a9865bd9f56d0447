"""The truth of a scene, for every track that has a protocol and the data it needs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.datasets.scenes import ImageScene
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.matching.truth import build_truth as build_matching_truth
from airzoo_bench.protocol.model import Protocol, ProtocolScene, find_protocol
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.truth import build_truth as build_reconstruction_truth
from airzoo_bench.retrieval.prepare import build_truth as build_retrieval_truth
from airzoo_bench.retrieval.settings import RetrievalProtocol, StatedRules
from airzoo_bench.retrieval.truth import Positives, RetrievalTruth, offsets_of, position_columns

P = TypeVar("P", bound=Protocol)

_BY_POSITION = ("plane", "dsm", "iou")


@dataclass(frozen=True)
class BenchmarkProtocols:
    """The protocols of one benchmark; a scene has at most one of each track."""

    every: tuple[Protocol, ...]

    @classmethod
    def find(cls, names: Collection[str], root: Path) -> BenchmarkProtocols:
        """Find protocols by their names or files."""
        return cls(tuple(find_protocol(name, root) for name in names))

    @property
    def benchmark(self) -> str:
        """The benchmark's name."""
        return self.every[0].benchmark

    @property
    def titles(self) -> dict[str, str]:
        """Titles of all scenes, by id."""
        return {scene.id: scene.title for one in self.every for scene in one.scenes}

    def first(self, kind: type[P]) -> P | None:
        """Return the first protocol of a track, by its class."""
        return next((one for one in self.every if isinstance(one, kind)), None)

    def for_scene(self, scene: str) -> BenchmarkProtocols:
        """Return the protocols that name a scene."""
        return BenchmarkProtocols(
            tuple(one for one in self.every if scene in [found.id for found in one.scenes])
        )

    def restrict(self, scenes: Collection[str]) -> BenchmarkProtocols:
        """Cut the protocols to some scenes; one that loses scenes is named partial."""
        left = [tuple(scene for scene in one.scenes if scene.id in scenes) for one in self.every]
        kept = [(one, some) for one, some in zip(self.every, left, strict=True) if some]
        if any(some != one.scenes for one, some in kept):
            return BenchmarkProtocols(tuple(_partial(one, some) for one, some in kept))
        whole = len(kept) == len(self.every)
        return self if whole else BenchmarkProtocols(tuple(one for one, _ in kept))


def _partial(protocol: Protocol, scenes: tuple[ProtocolScene, ...]) -> Protocol:
    title = f"{protocol.title} ({len(scenes)} of {len(protocol.scenes)} scenes)"[-120:]
    names = {"name": f"{protocol.name}-partial", "benchmark": f"{protocol.benchmark}-partial"}
    return protocol.model_copy(update={"scenes": scenes, "title": title, **names})


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
    """A scene's truth by track, None where a track has none; `missing` says why it has none."""

    retrieval: RetrievalTruth | None = None
    matching: MatchingTruth | None = None
    reconstruction: ReconstructionTruth | None = None
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks that have truth."""
        return tuple(track for track in TRACKS.names() if getattr(self, track, None) is not None)


def build_truths(
    inputs: SceneInputs,
    protocols: BenchmarkProtocols,
    cloud: Path | None = None,
    reconstructed: pd.Series[bool] | None = None,
) -> SceneTruths:
    """Make the truth of a scene for every track that has a protocol and the data it needs."""
    made: dict[str, Any] = {}
    missing: dict[str, str] = {}
    for protocol in protocols.every:
        if what := _missing_part(inputs, protocol, cloud):
            missing[protocol.track] = what
        elif isinstance(protocol, RetrievalProtocol):
            made["retrieval"] = build_retrieval_truth(inputs, *protocol.map_rules())
        elif isinstance(protocol, MatchingProtocol):
            truth = build_matching_truth(inputs, protocol.crop, protocol.prior)
            if truth.queries.empty:
                reasons = "; ".join(truth.excluded["reason"].unique())
                missing["matching"] = f"no photo has a crop of the map: {reasons}"
            else:
                made["matching"] = truth
        elif cloud is not None:
            made["reconstruction"] = build_reconstruction_truth(inputs, cloud, reconstructed)
    return SceneTruths(**made, missing=missing)


def _missing_part(inputs: SceneInputs, protocol: Protocol, cloud: Path | None) -> str:
    """Say which part of a scene is missing for the truth of a protocol; empty where none is."""
    there = {"map": inputs.dom is not None, "surface model": inputs.dsm is not None}
    if isinstance(protocol, ReconstructionProtocol):
        there = {"true cloud": cloud is not None}
    elif isinstance(protocol, RetrievalProtocol):
        by_position = protocol.map_rules()[1].rule in _BY_POSITION
        there = {"map": not by_position or bool(inputs.dom or inputs.gallery)}
    elif isinstance(protocol, MatchingProtocol) and protocol.crop is None:
        there = {"map for each photo": inputs.maps is not None}
    lacking = [what for what, is_there in there.items() if not is_there]
    if lacking:
        return f"there is no {' and no '.join(lacking)}"
    by_prior = isinstance(protocol, MatchingProtocol) and protocol.prior.is_measured
    if by_prior and "prior_x" not in inputs.photos.columns:
        return "no photo has a prior (position, altitude and angles) besides its true pose"
    return ""


def build_stated_truth(scene: ImageScene, rules: StatedRules) -> RetrievalTruth:
    """Lay out the pairs that a benchmark states as the truth of a scene."""
    pairs = scene.pairs
    photos, tiles = (one.sort_values("id", kind="stable") for one in (scene.queries, scene.gallery))
    query, tile = (
        table.index.get_indexer(pd.Index(pairs[name])).astype(np.int64)
        for table, name in ((photos, "query"), (tiles, "tile"))
    )
    photos, tiles = photos.reset_index(drop=True), tiles.reset_index(drop=True)
    order = np.lexsort((tile, query))
    overlaps = Positives(
        offsets_of(np.bincount(query, minlength=len(photos))),
        tile[order].astype(np.int32),
        pairs["overlap"].to_numpy(float)[order] if "overlap" in pairs else None,
    )
    positives = overlaps.where(pairs["positive"].to_numpy(bool)[order])
    kept = (positives.counts > 0) | (rules.without_positive == "miss")
    left_out = photos[["id", "image"]].assign(reason="no image of the gallery answers it")[~kept]
    rows, asked = np.flatnonzero(kept), photos[kept].reset_index(drop=True)
    places = position_columns(photos)
    return RetrievalTruth(
        scene.scene,
        asked.drop(columns=places),
        asked[["id", *places]],
        tiles,
        positives.take(rows),
        left_out.reset_index(drop=True),
        tiles[["id", "image"]].iloc[:0],
        overlaps.take(rows),
    )
