"""What no method is needed for: the prior as an answer; what the seed alone changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.evaluation.evaluate import check
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import Poses, camera_to_world
from tests.matching.evaluated import evaluated
from tests.matching.world import (
    N_QUERIES,
    World,
    made_matching_protocol,
    make_world,
)


def test_the_prior_itself_is_a_reference(world: World, tmp_path: Path) -> None:
    run = evaluated(world, tmp_path, world.matches())
    priors = world.truth.priors
    copied = world.named(rotations=priors.rotation, centres=priors.centres)
    copy = evaluated(world, tmp_path, copied)
    floor = run.result.references["Prior itself"]
    assert floor == copy.result.references["Prior itself"]
    result = copy.result
    # A copy is made orthonormal once more, which moves its last bit.
    for part, own in ((floor.overall, result.overall), (floor.pooled, result.pooled)):
        assert part == pytest.approx(own, rel=1e-9)
    assert floor.scenes["hills"] == pytest.approx(result.scenes["hills"], rel=1e-9)
    off = np.linalg.norm(priors.centres - world.truth.poses.centres, axis=1)
    assert floor.overall["error_m"] == pytest.approx(np.median(off))
    assert run.result.counts["hills"]["equal_to_prior"] == 0
    assert copy.result.counts["hills"]["equal_to_prior"] == N_QUERIES
    assert any("5 of 5 answers equal the prior" in n for n in copy.result.notes)
    assert not any("equal the prior" in note for note in run.result.notes)
    assert run.result.counts["hills"]["near_prior"] == 0


@pytest.mark.parametrize(
    ("away", "degrees", "near"), [(0.002, 0.0, 5), (0.04, 0.09, 5), (0.06, 0.0, 0), (0.0, 0.11, 0)]
)
@pytest.mark.parametrize("solved", [False, True])
def test_answers_about_the_prior_are_counted_however_they_are_given(
    world: World, tmp_path: Path, *, away: float, degrees: float, near: int, solved: bool
) -> None:
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    priors = world.truth.priors
    poses = Poses(
        rotation=turn @ priors.rotation, centres=priors.centres + np.array((away, 0.0, 0.0))
    )
    fields = world.named(rotations=poses.rotation, centres=poses.centres)
    if solved:  # rays of the pose itself, as pairs
        points = np.random.default_rng(0).uniform((-9, -9, 30), (9, 9, 50), (N_QUERIES, 40, 3))
        pixels = project(world.truth.cameras, points)
        fields = world.correspondences(list(pixels), points3d=list(camera_to_world(poses, points)))
    result = evaluated(world, tmp_path, fields).result
    counts = result.counts["hills"]
    assert (counts["equal_to_prior"], counts["near_prior"]) == (0, near)
    told = (
        f"{near} of 5 answers equal the prior, the photo's own GPS and gimbal angles, within 5 cm"
    )
    assert any(told in note for note in result.notes) == bool(near)
    if not solved:
        checked = check(tmp_path / "method.npz", data=world.root).notes
        assert any(told in note for note in checked) == bool(near)


def test_priors_that_are_the_truth_are_no_reference(tmp_path: Path) -> None:
    world = make_world(tmp_path, made_matching_protocol(prior={"source": "truth"}))
    assert evaluated(world, tmp_path, world.matches()).result.references == {}
