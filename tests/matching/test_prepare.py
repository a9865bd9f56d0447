"""Which photos become queries of the matching track, and why others do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.queries import POSE_COLUMNS, PRIOR_COLUMNS, SceneInputs, poses_of
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.poses import (
    angles_to_rotations,
    matrix_to_quaternion,
    rotations_to_angles,
)
from airzoo_bench.matching.prepare import build_truth
from airzoo_bench.matching.settings import Crop, Prior
from airzoo_bench.matching.truth import MatchingTruth
from tests.matching.world import MAP_PX, made_inputs


def crop_rule(margin: float, max_range_m: float) -> Crop:
    return Crop(
        margin=margin,
        max_range_m=max_range_m,
        missing_heights="nearest",
        nearest_of_px=10_000,
    )


CROP = crop_rule(0.1, 500.0)
METADATA, TRUTH = Prior(source="metadata"), Prior(source="truth")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> SceneInputs:
    return made_inputs(tmp_path_factory.mktemp("sources"))


def built(inputs: SceneInputs, photos: pd.DataFrame, prior: Prior = METADATA) -> MatchingTruth:
    return build_truth(replace(inputs, photos=photos), CROP, prior)


def with_priors(inputs: SceneInputs, rows: slice, **values: float) -> pd.DataFrame:
    photos = inputs.photos.copy()
    for column, value in values.items():
        photos.loc[photos.index[rows], column] = value
    return photos


def test_every_photo_with_a_prior_is_a_query(inputs: SceneInputs) -> None:
    truth = built(inputs, inputs.photos)
    assert truth.queries["id"].tolist() == inputs.photos["id"].tolist()
    assert truth.excluded.empty
    assert truth.excluded.columns.tolist() == ["id", "image", "reason"]
    assert (truth.crops[:, 2:] > 60).all()
    assert (truth.crops[:, :2] + truth.crops[:, 2:] <= MAP_PX).all()


@pytest.mark.parametrize("column", ["prior_x", "prior_qz", "prior_z"])
def test_photos_without_a_whole_prior_are_left_out(inputs: SceneInputs, column: str) -> None:
    truth = built(inputs, with_priors(inputs, slice(1, 3), **{column: np.nan}))
    assert truth.queries["id"].tolist() == ["hills/q0", "hills/q3", "hills/q4"]
    assert truth.excluded["id"].tolist() == ["hills/q1", "hills/q2"]
    assert truth.excluded["image"].tolist() == ["q1.png", "q2.png"]
    assert truth.excluded["reason"].str.contains("no GPS position or gimbal angles").all()
    whole = built(inputs, inputs.photos)
    np.testing.assert_array_equal(truth.crops, whole.crops[[0, 3, 4]])


def test_photos_that_do_not_see_the_map_are_left_out(inputs: SceneInputs) -> None:
    away = inputs.photos["prior_x"].iloc[4] + 20_000
    photos = with_priors(inputs, slice(4, 5), prior_x=away)
    photos.loc[photos.index[0], "prior_y"] = np.nan
    truth = built(inputs, photos)
    reasons = dict(zip(truth.excluded["id"], truth.excluded["reason"], strict=True))
    assert list(reasons) == ["hills/q0", "hills/q4"]
    assert "no GPS" in reasons["hills/q0"]
    assert "does not see the map" in reasons["hills/q4"]


def test_no_prior_at_all_leaves_no_query(inputs: SceneInputs) -> None:
    truth = built(inputs, with_priors(inputs, slice(None), prior_z=np.nan))
    assert truth.queries.empty
    assert len(truth.excluded) == 5


@pytest.mark.parametrize("away_m", [0.0, 1e-6, 1e-2, 0.05])
def test_a_prior_that_is_the_truth_is_refused(inputs: SceneInputs, away_m: float) -> None:
    photos = inputs.photos.copy()
    photos[list(PRIOR_COLUMNS)] = photos[list(POSE_COLUMNS)].to_numpy()
    photos["prior_x"] += away_m
    # A quaternion and its negative are one rotation.
    photos[["prior_qw", "prior_qx", "prior_qy", "prior_qz"]] *= -1
    if away_m > 0.02:
        assert len(built(inputs, photos).queries) == 5
        return
    with pytest.raises(BenchmarkError, match="equal the ground truth") as caught:
        built(inputs, photos)
    assert "prior.source = 'truth'" in str(caught.value)


@pytest.mark.parametrize("decimals", [1, 2])
@pytest.mark.parametrize("moved", [0, 2])
def test_a_prior_that_is_the_truth_through_xmp_is_refused(
    inputs: SceneInputs, decimals: int, moved: int
) -> None:
    # As an exporter writes it: metres to the millimetre, angles to so many decimals of a degree.
    # Moving less than half of the photos away hides nothing.
    photos = inputs.photos.copy()
    poses = poses_of(photos)
    angles = np.round(rotations_to_angles(poses.rotation, convergence_deg=0.0), decimals)
    turned = angles_to_rotations(*angles.T, convergence_deg=0.0)
    photos[list(PRIOR_COLUMNS[:4])] = matrix_to_quaternion(turned)
    photos[list(PRIOR_COLUMNS[4:])] = np.round(poses.centres, 3)
    photos.loc[photos.index[:moved], "prior_x"] += 30.0
    with pytest.raises(BenchmarkError, match=f"truth in {5 - moved} of 5 photos"):
        built(inputs, photos)


def test_truth_as_prior_by_name(inputs: SceneInputs) -> None:
    photos = inputs.photos.drop(columns=list(PRIOR_COLUMNS))
    truth = built(inputs, photos, TRUTH)
    assert len(truth.queries) == 5
    np.testing.assert_array_equal(truth.priors.centres, truth.poses.centres)
    # The crop is another one: that of metadata is a few metres off.
    assert (truth.crops != built(inputs, inputs.photos).crops).any()


def test_margin_and_range_come_from_the_protocol(inputs: SceneInputs) -> None:
    wide = build_truth(inputs, crop_rule(0.3, 500.0), METADATA)
    near = build_truth(inputs, crop_rule(0.1, 50.0), METADATA)
    usual = built(inputs, inputs.photos)
    assert (wide.crops[:, 2:] > usual.crops[:, 2:]).all()
    assert (near.crops[:, 2:] < usual.crops[:, 2:]).all()


def test_the_surface_model_is_named_by_its_bytes(inputs: SceneInputs, tmp_path: Path) -> None:
    other = tmp_path / "dsm.tif"
    other.write_bytes(inputs.dsm.read_bytes() + b"\0")
    moved = build_truth(replace(inputs, dsm=other), CROP, METADATA)
    assert moved.maps[0].dsm_sha256 != built(inputs, inputs.photos).maps[0].dsm_sha256
