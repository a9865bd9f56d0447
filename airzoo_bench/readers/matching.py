"""What readers of the matching track share: the images of a benchmark by name, and poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.readers.names import ImageNames, names_in

if TYPE_CHECKING:
    from airzoo_bench.evaluation.queries import QueryPredictions
    from airzoo_bench.evaluation.reader import Reading
    from airzoo_bench.geometry.arrays import Bools, Floats
    from airzoo_bench.matching.predictions import GivenPoses
    from airzoo_bench.matching.truth import MatchingTruth, ReferenceMap

__all__ = ["NamedPoses", "posed", "refuse_other_world", "scenes_of"]

_FAR_M = 50_000.0  # no photo of a map is taken so far from its middle


def scenes_of(reading: Reading, where: Path) -> Sequence[MatchingTruth]:
    """Return the scenes that names are looked up in."""
    if not reading.truths:
        raise PredictionError(
            "its names of images mean nothing without the benchmark, whose folder is missing",
            where=where,
            expected="a prepared benchmark",
            fix="say where it is with --data, or prepare it",
        )
    return reading.truths


@dataclass(frozen=True, eq=False)
class NamedPoses:
    """Poses of N images, world-to-camera.

    Attributes
    ----------
    names : sequence of str
    rotation : (N, 4) or (N, 3, 3) array
        Quaternions w x y z, or matrices.
    place : (N, 3) array
        Translations, or centres.
    found : (N,) bool array
        Whether there is a pose.
    centred : bool
        Whether `place` has centres.
    """

    names: Sequence[str]
    rotation: Floats
    place: Floats
    found: Bools
    centred: bool = False


def posed(
    given: NamedPoses, reading: Reading, path: Path
) -> tuple[QueryPredictions[GivenPoses], int]:
    """Make predictions of poses whose names are those of photos; count those of others."""
    import numpy as np

    from airzoo_bench.evaluation.queries import QueryPredictions
    from airzoo_bench.matching.predictions import given_poses

    scenes = scenes_of(reading, path)
    known = ImageNames.of(
        "query",
        names_in(scene.queries for scene in scenes),
        left_out=names_in(scene.excluded for scene in scenes),
        scenes=reading.scenes,
    )
    ids = known.find_all(given.names, path)
    kept = np.array([row for row, one in enumerate(ids) if one is not None], dtype=np.int64)
    names = [given.names[row] for row in kept]
    part = NamedPoses(
        names, given.rotation[kept], given.place[kept], given.found[kept], given.centred
    )
    query_ids = np.array([ids[row] for row in kept], dtype=str)
    there = part.found.reshape(-1, *[1] * (part.rotation.ndim - 1))
    rotation = np.where(there, part.rotation, np.nan)
    place = np.where(part.found[:, None], part.place, np.nan)
    content = given_poses(path, part.names, rotation, place, centred=part.centred)
    return QueryPredictions(path, None, query_ids, content), len(ids) - len(kept)


def refuse_other_world(content: GivenPoses, scenes: Sequence[MatchingTruth], path: Path) -> None:
    """Refuse cameras that all stand far from every map."""
    import numpy as np

    centres = content.poses.centres[content.found]
    if not len(centres):
        return
    middle = np.median(centres[:, :2], axis=0)
    maps = [(scene.scene_map, scene.scene) for scene in scenes]
    offsets = [(middle - _map_centre(one), name) for one, name in maps if one is not None]
    if not offsets:  # each photo has a map of its own
        return
    (offset, nearest) = min(offsets, key=lambda one: float(np.hypot(*one[0])))
    if float(np.hypot(*offset)) > _FAR_M:
        raise PredictionError(
            f"its cameras stand around ({middle[0]:.1f}, {middle[1]:.1f}), off the map of "
            f"{nearest} by ({offset[0]:.1f}, {offset[1]:.1f}) m",
            where=path,
            expected="poses in the scene's CRS, in metres",
            fix="add the offset that was taken off, or bring the model to the CRS by points that "
            "are known in both (colmap model_aligner)",
        )


def _map_centre(reference: ReferenceMap) -> Floats:
    """Return where the middle of a map lies in the CRS of the scene, which is its DSM's."""
    import numpy as np

    from airzoo_bench.geometry.crs import change_of_plane
    from airzoo_bench.geometry.rasters import open_info, pixel_to_world

    dom = reference.dom
    middle = pixel_to_world(dom.transform, np.array([[dom.width / 2, dom.height / 2]]))
    found: Floats = change_of_plane(dom.crs, open_info(reference.dsm).crs)(middle)[0]
    return found
