"""Which scores the reconstruction track has, and their columns in the records."""

from __future__ import annotations

from airzoo_bench.reconstruction.settings import ReconstructionScores
from airzoo_bench.results.scores import Score

__all__ = ["RECORDED", "f1_column", "pose_auc_column", "reconstruction_scores", "share_column"]

RECORDED = frozenset(
    (
        *("scene", "query", "answered", "points", "distrusted", "not_finite", "outside", "thinned"),
        *("truth_points", "truth_unseen", "truth_outside", "truth_thinned"),
        *("cameras", "cameras_missing", "inlier_cameras", "alignment", "scale"),
        *("centres_rms_m", "centres_median_m", "rotations_median_deg"),
    )
)
"""Columns of the records that are neither scores nor conditions of the scenes."""


def f1_column(limit_m: float) -> str:
    """Name the column of F1."""
    return f"f1_{limit_m:g}m"


def share_column(what: str, limit_m: float) -> str:
    """Name the column of ``precision`` or ``recall``."""
    return f"{what}_{limit_m:g}m"


def pose_auc_column(limit_deg: float) -> str:
    """Name the column of the area under the curve of relative pose errors."""
    return f"pose_auc_{limit_deg:g}deg"


def reconstruction_scores(settings: ReconstructionScores, *, with_poses: bool) -> list[Score]:
    """Return the scores that a protocol asks for, those of poses where predictions hold any."""
    main = settings.headline_below_m
    scores = [
        _distance("chamfer_m", "Chamfer", headline=True),
        _distance("accuracy_m", "Accuracy", headline=True),
        _distance("completeness_m", "Completeness", headline=True),
        Score.share(share_column("precision", main), f"P@{main:g}m", headline=True),
        Score.share(share_column("recall", main), f"R@{main:g}m", headline=True),
        Score.share(f1_column(main), f"F1@{main:g}m", headline=True),
    ]
    for limit in settings.f1_below_m:
        if limit != main:
            scores.append(Score.share(share_column("precision", limit), f"P@{limit:g}m"))
            scores.append(Score.share(share_column("recall", limit), f"R@{limit:g}m"))
            scores.append(Score.share(f1_column(limit), f"F1@{limit:g}m", headline=True))
    scores.append(_distance("accuracy_median_m", "Accuracy, median"))
    scores.append(_distance("completeness_median_m", "Completeness, median"))
    if with_poses:
        scores += [
            Score.share(pose_auc_column(a), f"AUC@{a:g}°") for a in settings.pose_auc_below_deg
        ]
        scores.append(Score.share("cameras_placed", "Cameras placed"))
        scores += [_distance("ate_m", "ATE"), _distance("rpe_m", "RPE")]
        angle = Score("rpe_deg", "RPE, rotation", "deg", higher_is_better=False, average="mean")
        scores.append(angle)
    return scores


def _distance(column: str, title: str, *, headline: bool = False) -> Score:
    return Score(column, title, "m", higher_is_better=False, average="mean", headline=headline)
