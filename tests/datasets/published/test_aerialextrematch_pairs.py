"""AerialExtreMatch's evaluation pairs: converted where they are trusted, scored by the face."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

import airzoo_bench as ab
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import angles_to_rotations

# What stands in these two are the lines of docs/benchmarks.md.


def convert() -> None:
    d = np.load("class_0.npy", allow_pickle=True).item()  # runs what the file says
    poses = np.stack(d["poses"]).astype(np.float64)
    np.savez("class_0.npz", poses=poses, pair=np.array(d["pair"]))


def score(predicted: ArrayLike) -> tuple[ab.QueryScores, Floats]:
    known = np.load("class_0.npz")  # plain numbers
    query = known["poses"][known["pair"][:, 0]]  # world-to-camera, of the first image of each pair
    errors = ab.pose_errors(predicted, query)  # (N, 4, 4), NaN where a pair has no answer
    assert errors.rotation_deg is not None
    worse = np.maximum(errors.translation_m, errors.rotation_deg)
    return ab.pose_scores((worse, None), [(1, 1), (3, 3), (5, 5), (10, 10), (20, 20)]), worse


def auc_joined_by_lines(errors: Floats, limit: float) -> float:
    """Return the area as AerialExtreMatch computes it, by joining the steps."""
    ascending = np.append(0.0, np.sort(errors))
    recall = np.arange(len(ascending)) / len(errors)
    last = np.searchsorted(ascending, limit)
    x, y = np.append(ascending[:last], limit), np.append(recall[:last], recall[last - 1])
    return float(((y[1:] + y[:-1]) / 2 * np.diff(x)).sum() / limit)


def test_pairs_are_scored_as_by_their_own_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rng, count = np.random.default_rng(0), 60
    poses = np.tile(np.eye(4), (2 * count, 1, 1))
    yaw, pitch = rng.uniform(-180, 180, 2 * count), rng.uniform(-90, -20, 2 * count)
    poses[:, :3, :3] = angles_to_rotations(yaw, pitch, 0.0, convergence_deg=0.0)
    poses[:, :3, 3] = rng.normal(0, 100, (2 * count, 3))
    made = {"poses": list(poses), "pair": [(2 * n, 2 * n + 1) for n in range(count)]}
    np.save("class_0.npy", np.array(made, dtype=object), allow_pickle=True)
    convert()
    assert np.load("class_0.npz", allow_pickle=False)["poses"].shape == (2 * count, 4, 4)
    assert score(poses[::2])[0]["auc_1m"] == 1.0

    moved = poses[::2].copy()
    moved[:, 0, 3] += rng.exponential(8.0, count)
    moved[::7] = np.nan
    scores, worse = score(moved)
    for limit in (1, 3, 5, 10, 20):
        theirs = auc_joined_by_lines(worse, limit)
        assert 0.0 <= theirs - scores[f"auc_{limit}m"] <= 0.5 / count + 1e-12
    assert 0.0 < scores["auc_20m"] < 1.0
