from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.datasets.mini.noise import noisy_priors
from airzoo_bench.geometry.poses import Poses, angles_to_rotations, rotation_angle_deg


def made_poses(count: int) -> Poses:
    spread = np.linspace(0, 1, count)
    rotations = angles_to_rotations(360 * spread, -45 - 30 * spread, 0.0, convergence_deg=0.0)
    return Poses.from_centres(rotations, np.stack([spread, spread, spread + 100], axis=1))


def test_spread_is_what_was_asked() -> None:
    poses = made_poses(4000)
    names = [f"photo_{i}" for i in range(4000)]
    offsets = noisy_priors(names, poses, 0).centres - poses.centres
    np.testing.assert_allclose(offsets.std(axis=0), [2.0, 2.0, 3.0], rtol=0.05)
    np.testing.assert_allclose(offsets.mean(axis=0), 0, atol=0.2)
    # Normal enough: as many beyond one and two deviations as there should be.
    scaled = np.abs(offsets / [2.0, 2.0, 3.0])
    assert (scaled > 1).mean() == pytest.approx(0.317, abs=0.02)
    assert (scaled > 2).mean() == pytest.approx(0.0455, abs=0.01)


def test_rotations_turn_by_a_degree_or_two() -> None:
    poses = made_poses(500)
    names = [str(i) for i in range(500)]
    turned = rotation_angle_deg(noisy_priors(names, poses, 0).rotation, poses.rotation)
    assert 0.5 < np.median(turned) < 3
    assert turned.max() < 12


def test_noise_belongs_to_the_name_and_the_seed() -> None:
    poses = made_poses(3)
    together = noisy_priors(["a", "b", "c"], poses, 0)
    second = Poses(rotation=poses.rotation[1:2], centres=poses.centres[1:2])
    alone = noisy_priors(["b"], second, 0)
    np.testing.assert_array_equal(alone.centres[0], together.centres[1])
    other = noisy_priors(["a", "b", "c"], poses, 1)
    assert not np.allclose(other.centres, together.centres)


def test_the_numbers_are_the_same_everywhere() -> None:
    one = Poses.from_centres(np.eye(3)[None], np.zeros((1, 3)))
    prior = noisy_priors(["city/0001"], one, 0)
    assert prior.centres[0].tolist() == [1.53424072265625, -0.400146484375, 6.124420166015625]
