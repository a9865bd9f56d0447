"""The real scene, spoiled in the ways that real scenes are, is told from the sound one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.facts_lines import plausibility_warnings
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.photos import prepare_photos
from airzoo_bench.datasets.scene_facts import SceneFacts
from tests.own_protocols import photo_protocols

GIMBAL = "more than 45 in 6 of 18 (first 3: park/DJI_0024, park/DJI_0025, park/DJI_0026)"


@pytest.fixture
def sources(brighton: Path) -> PhotoOptions:
    names = ("images", "poses.json", "dom_10cm.tif")
    files = (brighton / name for name in names)
    return PhotoOptions("park", *files, dsm=brighton / "dsm_10cm.tif")


def facts_of(sources: PhotoOptions, folder: Path) -> SceneFacts:
    settings = PrepareSettings(folder / "park", folder)
    return prepare_photos(sources, photo_protocols("park", (256, 128)), settings).facts["park"]


def test_the_sound_scene(sources: PhotoOptions, tmp_path: Path) -> None:
    facts = facts_of(sources, tmp_path)
    assert facts.gps is not None
    assert facts.priors is not None
    assert facts.crop_shares is not None
    assert facts.gps.distance_m == pytest.approx(0.6, abs=0.1)
    assert facts.cameras.height_m == pytest.approx(35.1, abs=0.1)
    assert facts.cameras.relative_height_m == pytest.approx(40.1, abs=0.01)
    assert facts.survey.valid_share == pytest.approx(0.437, abs=0.001)
    # With the range as the end of rays over holes the mean was 0.96, and 11 crops the whole map.
    assert facts.crop_shares.mean() == pytest.approx(0.501, abs=0.002)
    assert facts.crop_shares.max() < 0.7
    said = plausibility_warnings(facts)
    assert len(said) == 3
    assert GIMBAL in said[0]
    assert "56% of the map is exactly one colour (0 0 0)" in said[1]
    assert "100% of the photos, which see 65 m" in said[2]


def poses_moved(sources: PhotoOptions, folder: Path) -> PhotoOptions:
    file = json.loads(sources.poses.read_text())
    for image in file["images"].values():
        image["center_utm"][0] += 40.0
    (folder / "poses.json").write_text(json.dumps(file))
    return replace(sources, poses=folder / "poses.json")


def centres_as(change: Callable[[Any], Any]) -> Any:
    def changed(sources: PhotoOptions, folder: Path) -> PhotoOptions:
        file = json.loads(sources.poses.read_text())
        for image in file["images"].values():
            image["center_utm"] = np.asarray(change(image["center_utm"]), np.float64).tolist()
        (folder / "poses.json").write_text(json.dumps(file))
        cloud = sources.poses.parent / "model.laz"
        return replace(sources, poses=folder / "poses.json", cloud=cloud)

    return changed


def surface(change: Callable[[Any], Any], **profile: Any) -> Any:
    def changed(sources: PhotoOptions, folder: Path) -> PhotoOptions:
        with rasterio.open(sources.dsm) as dataset:
            heights, kept = dataset.read(1), dataset.profile
        with rasterio.open(folder / "dsm.tif", "w", **(kept | profile)) as dataset:
            dataset.write(change(heights).astype(np.float32), 1)
        return replace(sources, dsm=folder / "dsm.tif")

    return changed


SUSPECT = {
    "float32": (centres_as(np.float32), "through float32: an error of 0.15 m is to be expected"),
    "poses": (poses_moved, "poses are 40.1 m from their own photos' GPS (median), by +4"),
    "lowered": (surface(lambda z: z - 27.5), "62.6 m above the surface model"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", list(SUSPECT))
def test_what_is_suspect(case: str, sources: PhotoOptions, tmp_path: Path) -> None:
    change, said = SUSPECT[case]
    found = plausibility_warnings(facts_of(change(sources, tmp_path), tmp_path))
    assert any(said in one for one in found), found
    assert any(GIMBAL in one for one in found)


@pytest.mark.slow
def test_stated_feet_are_metres(sources: PhotoOptions, tmp_path: Path) -> None:
    feet = surface(lambda z: z / (1200 / 3937), crs="EPSG:32615+6360")(sources, tmp_path)
    facts = facts_of(feet, tmp_path)
    assert facts.cameras.height_m == pytest.approx(35.1, abs=0.1)
    assert len(plausibility_warnings(facts)) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (surface(lambda z: z / 0.3048), "every camera is below the surface: they are at 198.4"),
        (surface(lambda z: z * 1000), "look at their unit: they must be in metres or feet"),
        (
            surface(lambda z: np.where(np.isnan(z), -9999, z), nodata=None),
            "56.3% of its heights are no heights of the ground: they go from -9999 to 168.9",
        ),
        (
            surface(lambda z: np.where(np.isnan(z), 0, z), nodata=None),
            "the surface model is 0.0 to 168.9 m high, 0.0 in the median",
        ),
    ],
)
def test_what_cannot_be(change: Any, said: str, sources: PhotoOptions, tmp_path: Path) -> None:
    with pytest.raises(UserError) as caught:
        facts_of(change(sources, tmp_path), tmp_path)
    assert said in str(caught.value)
    assert not (tmp_path / "park").exists()
