"""The facts of a scene of a benchmark folder, for checks of what was prepared before."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import read_queries
from airzoo_bench.benchmark.scene_inputs import SceneInputs
from airzoo_bench.datasets.cloud_checks import check_cloud
from airzoo_bench.datasets.dji import PhotoPrior, read_prior
from airzoo_bench.datasets.raster_checks import check_map, surveyed
from airzoo_bench.datasets.scene_facts import SceneFacts, camera_facts, scene_facts
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import read_truth as read_retrieval_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["folder_facts"]


def folder_facts(benchmark: Benchmark, scene: str) -> SceneFacts | None:
    """Compare the parts of a prepared scene with each other, as `prepare photos` does.

    Parameters
    ----------
    benchmark : Benchmark
    scene : str
        The scene's id.

    Returns
    -------
    SceneFacts or None
        None where the map or the surface model is not there. Photos that are not there have no
        metadata.

    Raises
    ------
    UserError
        What is there is damaged, or not what was prepared.
    """
    import pandas as pd

    entry, home = benchmark.scene(scene), benchmark.scene_folder(scene)
    dom, dsm = benchmark.resolve(entry.dom), benchmark.resolve(entry.dsm or "")
    if not (entry.dsm and dom.is_file() and dsm.is_file()):
        return None
    tracks = benchmark.file.tracks
    photos = read_queries(home, pd.DataFrame({"id": []}))
    inputs = SceneInputs(scene, photos, entry.crs, check_map(dom), dsm, entry.plane_height_m)
    metadata = _metadata(benchmark.resolve(entry.images), photos)
    has_matching = "matching" in tracks and (home / "matching").is_dir()
    cloud = benchmark.resolve(entry.cloud) if entry.cloud else None
    return scene_facts(
        inputs,
        metadata,
        read_retrieval_truth(home, scene) if "retrieval" in tracks else None,
        read_matching_truth(benchmark, scene) if has_matching else None,
        survey=surveyed(dsm),
        cameras=camera_facts(photos, dsm, metadata),
        cloud_over_surface_m=check_cloud(cloud, inputs) if cloud and cloud.is_file() else None,
    )


def _metadata(folder: Path, photos: pd.DataFrame) -> dict[str, PhotoPrior]:
    found = {}
    for name in photos["image"]:
        if (folder / name).is_file():
            found[name] = read_prior(folder / name)
    return found
