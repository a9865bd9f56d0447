"""A scene as its files state it, checked, and with the truth made: what a folder is written of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.benchmark.queries import SceneInputs, photo_table
from airzoo_bench.core.errors import BenchmarkError, UserError, first_of
from airzoo_bench.datasets.cloud_checks import check_cloud
from airzoo_bench.datasets.map_facts import check_overlap
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.raster_checks import (
    check_above_surface,
    check_map,
    check_map_scale,
    check_tile_count,
    lowest_heights,
    often_lowest,
    surveyed,
)
from airzoo_bench.datasets.scene_facts import MeasuredScene, SceneFacts, scene_facts
from airzoo_bench.datasets.sources import check_dsm_crs, check_metres, check_names, metric_crs
from airzoo_bench.datasets.truths import BenchmarkProtocols, SceneTruths, build_truths
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.heightfield import median_height
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.prepare import grouped_reasons
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["SceneContent", "scene_content"]


@dataclass(frozen=True, eq=False)
class SceneContent:
    """What is written of a scene into a benchmark folder.

    Attributes
    ----------
    inputs : SceneInputs
    truths : SceneTruths
    files : mapping of str to Path
        Photos, maps and clouds by the name that benchmark.toml has for them (`SceneFile`);
        ``images`` is a folder.
    facts : SceneFacts, optional
        What the parts say of each other.
    truth_accuracy_m : float, optional
        Standard error of the true positions, where it is stated.
    """

    inputs: SceneInputs
    truths: SceneTruths
    files: Mapping[str, Path]
    facts: SceneFacts | None = None
    truth_accuracy_m: float | None = None


def scene_content(native: NativeScene, protocols: BenchmarkProtocols) -> SceneContent:
    """Check a scene, measure its parts, and make its truth for every track that they serve."""
    protocols = protocols.of_scene(native.scene)
    scene = _measured(native)
    inputs = scene.inputs
    check_above_surface(scene.cameras, inputs.dsm)
    if inputs.dom is not None and inputs.dsm is not None:
        check_overlap(inputs.dom, open_info(inputs.dsm))
    if inputs.dom is not None or inputs.gallery is not None:
        check_map_scale(inputs)
        if protocols.retrieval is not None:
            check_tile_count(inputs.gallery_map, protocols.retrieval.map_rules()[0])
    above = None if native.cloud is None else check_cloud(native.cloud, inputs)
    truths = build_truths(inputs, protocols, native.cloud)
    retrieval = None if truths.retrieval is None else truths.retrieval.truth
    if retrieval is not None and retrieval.queries.empty:
        raise _nothing_to_ask(retrieval, native, scene)
    dropped = "" if protocols.retrieval is None else protocols.retrieval.gallery.dropped
    facts = scene_facts(scene, retrieval, truths.matching, above, dropped)
    return SceneContent(inputs, truths, native.files, facts, native.truth_accuracy_m)


def _measured(native: NativeScene) -> MeasuredScene:
    _check_photos(native)
    crs = _checked_crs(native)
    maps = [None if path is None else check_map(path) for path in (native.dom, native.gallery)]
    survey = None if native.dsm is None else surveyed(native.dsm)
    plane = native.plane_height_m
    if plane is None and native.dsm is not None:
        plane = median_height(native.dsm)
    table = photo_table(
        native.scene, native.names, native.cameras, native.poses, native.priors, plane
    )
    if native.conditions:
        table = table.merge(native.condition_table(), on="id", validate="one_to_one")
    inputs = SceneInputs(
        native.scene,
        table,
        crs,
        maps[0],
        native.dsm,
        plane,
        native.unposed,
        maps[1],
        native.maps,
    )
    return MeasuredScene.of(
        inputs, native.metadata, survey, native.images, is_metadata=native.is_metadata
    )


def _check_photos(native: NativeScene) -> None:
    check_names(native.names, native.images)
    missing = [name for name in native.names if not (native.images / name).is_file()]
    if missing:
        raise BenchmarkError(
            f"photos of scene {native.scene} are missing: "
            f"{first_of(map(repr, missing), len(native.names))}",
            where=native.images,
            expected="every photo that has a pose",
            fix="download them again, or look whether names differ in upper and lower case",
        )


def _checked_crs(native: NativeScene) -> str | None:
    """Return the CRS of the poses, which is that of the surface model, in true metres."""
    if native.crs is None or native.poses is None:
        return None
    if native.crs == LOCAL_CRS:
        if native.dom is not None or native.dsm is not None:
            raise BenchmarkError(
                f"the poses of scene {native.scene} are in a local frame, and there is a map",
                where=native.crs_place,
                expected="poses in a projected CRS where there is a map or a surface model",
            )
        return LOCAL_CRS
    crs = metric_crs(native.crs, native.crs_place)
    xy = native.poses.centres[:, :2]
    check_metres(crs, xy, native.crs_place, native.pose_source, native.dsm)
    if native.dsm is not None:
        check_dsm_crs(crs, native.dsm, native.pose_source)
    return crs.to_string()


def _nothing_to_ask(truth: RetrievalTruth, native: NativeScene, scene: MeasuredScene) -> UserError:
    reasons, fixes = grouped_reasons(truth.excluded)
    survey, found, tag = scene.survey, "", ""
    if {"x", "y", "z"} <= set(scene.inputs.photos):
        x, y, z = scene.inputs.photos[["x", "y", "z"]].median()
        found = f"; cameras are about ({x:.0f}, {y:.0f}, {z:.0f})"
    if survey is not None:
        found += f", the surface model is {survey.low:.1f} to {survey.high:.1f} m high"
        found += f", {scene.inputs.plane_height_m:.1f} in the median"
        if often_lowest(survey):
            tag = f"{lowest_heights(survey)} of the heights are exactly "
            tag += (
                f"{survey.low:.10g} m: if that means none, tag it (gdal_edit.py -a_nodata); else "
            )
    return BenchmarkError(
        f"no photo has a tile that answers it ({'; '.join(reasons)}){found}",
        where=native.pose_source,
        expected="at least one photo that a tile answers",
        fix=tag + "; or ".join(fixes),
    )
