"""Arguments that could give a wrong number in silence are refused by name, in every function."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import airzoo_bench as ab
from tests.api.place import made_errors, refused
from tests.statistics.support import ERROR, HIT, SOFT, random_methods, write_method

NAN = np.nan
MASKED = np.ma.masked_array([[1.0, 0, 1], [0, 0, 1]], mask=[[1, 0, 0], [0, 0, 0]])
EYE, ONE, LAST = np.eye(4)[None], [[0.0, 0, 0]], np.eye(4)[3][:, None] * (1.0, 0, 0, 0)
K = np.diag([500.0, 500.0, 1.0])
POINTS = np.random.default_rng(0).random((9, 3))
PIXELS, GOOD = POINTS[:, :2], [0.5] * 8
CENTRES = POINTS * (60, 40, 8) + (500_000, 5_200_000, 100)


def far(kind: Any = np.float64) -> np.ndarray:
    poses = np.zeros((2, 3, 4))
    poses[:, :, :3] = Rotation.random(2, random_state=0).as_matrix()
    poses[:, :, 3] = poses[:, :, :3] @ np.array((-576_663.2, -5_188_165.5, -197.0))
    return poses.astype(kind)


rank, ci, score = ab.retrieval_scores, ab.bootstrap_ci, ab.pose_scores
recall, ap, solve = ab.recall_at_k, ab.average_precision, ab.solve_pose
clouds, align, errors, chance = ab.cloud_scores, ab.align_cameras, ab.pose_errors, ab.chance_level
of_matrix = partial(rank, None)

# The argument that is named, the function, and calls that it refuses.
CASES: dict[tuple[str, Callable[..., Any]], list[list[Any]]] = {
    ("hits", recall): [
        [hits, 1] for hits in ([[2, 0]], [[NAN]], [], [["a"]], np.zeros((1, 1, 1)), MASKED)
    ],
    ("k", recall): [[[[1, 0]], k] for k in (0, 1.5, "1")],
    # Fewer positives than hits would lift AP above 1.
    ("n_positives", ap): [*([[[1, 1]], n] for n in (1, [2, 2], 1.0)), [[[0, 0]], 0]],
    ("variant", partial(ap, variant="coco")): [[[[1]], 1]],
    ("ranked_ids, positives", rank): [[[[1]], [{1}, {2}]]],
    ("ids", rank): [[[["1"]], [{1}]]],
    ("ranked_ids[0]", rank): [[[ids], [{1}]] for ids in ("t1", {"a", "b"}, MASKED)],
    ("ranked_ids", rank): [[[[1, 1]], [{1}]], [[[-1, 1]], [{1}]], ["ab", [{"a"}, {"b"}]]],
    ("positives", rank): [[[[1]], 5], [[[1], [2]], [[], []]], [[], []]],
    ("positives[0]", rank): [
        *([[[1]], [right]] for right in ({-1}, {"a": 1}, [1, 1])),
        # A matrix of relevances is no list of ids.
        *([[[0, 1, 2]] * 3, matrix] for matrix in (np.eye(3, dtype=int), np.eye(3).tolist())),
    ],
    ("ks", rank): [[[[1]], [{1}], ks] for ks in ((), (0,), 5)],
    ("ap", partial(rank, ap="kitti")): [[[[1]], [{1}]]],
    ("scores", partial(rank, scores=[[0.5]])): [[[[1]], [{1}]]],
    ("scores", partial(of_matrix, [[0]])): [[]],
    ("scores", partial(of_matrix, [[0]], scores=[[0.1, NAN]])): [[]],
    ("positives", partial(of_matrix, [[2]], scores=[[0.1, 0.2]])): [[]],
    ("n_positives", chance): [[n, 5] for n in ([], [6], [0])],
    ("predicted", errors): [
        *([x, EYE] for x in (EYE[0], 2 * EYE, EYE * (1, 1, -1, 1))),
        *([x, EYE] for x in (np.where(np.arange(4) == 3, NAN, EYE), EYE + LAST)),
        [far(np.float32), far()],
    ],
    ("predicted, true", errors): [[np.tile(EYE, (2, 1, 1)), EYE]],
    ("true", errors): [
        *([EYE, true] for true in (EYE * NAN, [[NAN, 0, 0]], [[0, 0]])),
        [far(), far(np.float32)],
        [far(), np.array([[576_663.2, 5_188_165.5, 197.0]] * 2, np.float32)],
    ],
    ("errors", score): [
        [made_errors(metres, 0 * metres)] for metres in (POINTS[0] * NAN, POINTS[:0])
    ],
    ("thresholds", score): [
        [made_errors(PIXELS[0], PIXELS[0]), limits]
        for limits in ([], [(5,)], [(0, 1)], [(5, NAN)], 5)
    ],
    ("pixels", solve): [[POINTS, POINTS, K], [PIXELS * NAN, POINTS, K]],
    ("pixels, points3d", solve): [[PIXELS[:3], POINTS, K]],
    ("points3d", solve): [
        [PIXELS, points, K] for points in (POINTS * np.inf, (POINTS + 5e6).astype(np.float32))
    ],
    ("camera", solve): [[PIXELS, POINTS, matrix] for matrix in (-K, K[:2], K * NAN)],
    ("camera", partial(solve, distortion=[0.1])): [[PIXELS, POINTS, K]],
    ("solver", partial(solve, solver="ransac")): [[PIXELS, POINTS, K]],
    ("max_error_px", partial(solve, max_error_px="5")): [[PIXELS, POINTS, K]],
    ("predicted", align): [
        *([x, CENTRES] for x in (CENTRES * NAN, CENTRES[:, :2], CENTRES * 1e200)),
        *([np.where(np.arange(3) == 0, NAN, CENTRES), CENTRES], [CENTRES[:2], CENTRES[:2]]),
    ],
    ("predicted, true", align): [[CENTRES[:-1], CENTRES], [CENTRES * 0, CENTRES]],
    ("true", align): [[CENTRES, true] for true in (CENTRES * NAN, CENTRES.astype("f4"))],
    ("true", clouds): [[ONE, true] for true in ([], [[NAN] * 3])],
    ("predicted", clouds): [
        *([x, ONE, 1] for x in ([[0.0, 0]], MASKED)),
        [CENTRES.astype("f4"), CENTRES, 0.2],
    ],
    ("threshold", clouds): [[ONE, ONE, x] for x in (0, NAN, "10", 1e300)],
    ("values", partial(ci, statistic="mean")): [
        [values] for values in ([], [NAN], [-np.inf, 1], [[1.0]], ["a"], 3.0, MASKED[0])
    ],
    ("values", partial(ci, statistic="share")): [[[50.0, 100]], [[-0.1]]],
    ("scenes", partial(ci, statistic="share")): [[GOOD, ["a"] * 7], [GOOD, ["a"] * 7 + [None]]],
    ("confidence", partial(ci, statistic="mean", confidence=95)): [[GOOD]],
    ("query_ids", partial(ab.evaluate, protocol="x")): [[{"query_ids": MASKED}]],
    ("results", ab.compare): [[[]], [[3]]],
}


@pytest.mark.parametrize("case", CASES)
def test_it_is_refused(case: Any) -> None:
    where, call = case
    for arguments in CASES[case]:
        refused(call, *arguments, where=where)


def test_refusals_of_comparisons(tmp_path) -> None:
    methods = random_methods(2, {"east": 12, "west": 9}, (HIT, ERROR, SOFT))
    folders = [write_method(tmp_path / m.name, m).parent for m in methods]
    refused(ab.compare, folders, where="scores", scores="mrr")
    one = ab.load_result(folders[0])
    assert "name=" in refused(ab.compare, [one, one], where="results")
    refused(one.plot, "pie", where="kind")
    for options in ({"scores": ["mr"]}, {"scene": "North"}, {"reference": "method09"}):
        with pytest.raises(ab.UserError, match="expected"):
            ab.compare(folders, **options)
