"""A made-up place as a benchmark folder, and the truth in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.photos import prepare_photos
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth
from tests.own_protocols import photo_protocols
from tests.support import Place


def prepared(
    place: Place, folder: Path, truth: dict[str, Any] | None = None, **options: Any
) -> Prepared:
    """Prepare a place with tiles of 64 px, 50 % overlap."""
    sizes = options.pop("tile_sizes_px", (64,))
    chosen = photo_protocols("park", sizes, truth)
    sources = PhotoOptions(
        "park", place.images, place.poses, place.dom, dsm=place.dsm, crs=options.pop("crs", None)
    )
    return prepare_photos(sources, chosen, PrepareSettings(folder, folder.parent, **options))


def truth_in(folder: Path) -> RetrievalTruth:
    benchmark = Benchmark.open(folder)
    return read_truth(benchmark.scene_folder("park"), "park")


def positives(truth: RetrievalTruth, query: str) -> set[str]:
    number = truth.queries["id"].tolist().index(f"park/{query}")
    return {truth.tiles["id"][t].split("/")[1] for t in truth.positives.of(number)}
