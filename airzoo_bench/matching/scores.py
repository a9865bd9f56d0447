"""Which scores the matching track has, and their columns in the records."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.matching.metrics import PoseErrors, area_share, within
from airzoo_bench.matching.settings import MatchingScores
from airzoo_bench.results.scores import Score

__all__ = [
    "RECORDED",
    "auc_column",
    "matching_scores",
    "pose_column",
    "pose_columns",
    "translation_column",
]

RECORDED = frozenset(
    (
        *("scene", "query", "answered", "status", "failed"),
        *("matches", "lifted", "outside_map", "outside_dsm", "no_height", "beyond_limit"),
        "inliers",
    )
)
"""Columns of the records that are neither scores nor conditions of the queries."""


def translation_column(limit_m: float) -> str:
    """Name the column of translation recall."""
    return f"within_{limit_m:g}m"


def pose_column(limit_m: float, limit_deg: float) -> str:
    """Name the column of pose recall."""
    return f"within_{limit_m:g}m_{limit_deg:g}deg"


def auc_column(limit_m: float) -> str:
    """Name the column of the area under the error curve."""
    return f"auc_{limit_m:g}m"


def matching_scores(settings: MatchingScores) -> list[Score]:
    """Return the scores that a protocol asks for."""
    trusted = settings.orientation_is_trusted
    pose = [
        Score.share(pose_column(m, deg), f"@{m:g}m,{deg:g}°", headline=True)
        for m, deg in (settings.pose_below_m_deg if trusted else ())
    ]
    median = Score(
        "error_m", "Median", "m", higher_is_better=False, average="median", headline=True
    )
    within = [
        Score.share(translation_column(m), f"@{m:g}m", headline=True)
        for m in settings.translation_below_m
    ]
    beyond = [
        Score("horizontal_m", "Horizontal", "m", higher_is_better=False, average="median"),
        Score("vertical_m", "Vertical", "m", higher_is_better=False, average="median"),
    ]
    if trusted:
        beyond.append(
            Score("rotation_deg", "Rotation", "deg", higher_is_better=False, average="median")
        )
    beyond += [Score.share(auc_column(m), f"AUC@{m:g}m") for m in settings.auc_up_to_m]
    return [median, *within, *pose, *beyond]


def pose_columns(errors: PoseErrors, settings: MatchingScores) -> dict[str, Floats]:
    """Return the columns of the records that errors of Q poses give: the errors, then scores."""
    metres, degrees = errors.translation_m, errors.rotation_deg
    columns = {
        "error_m": metres,
        "horizontal_m": errors.horizontal_m,
        "vertical_m": errors.vertical_m,
    }
    if degrees is not None:
        worst = settings.failed_rotation_deg
        failed = np.inf if worst == "infinite" else worst
        columns["rotation_deg"] = np.where(np.isfinite(degrees), degrees, failed)
    columns |= {
        translation_column(m): within(metres, None, m) for m in settings.translation_below_m
    }
    if settings.orientation_is_trusted:
        for m, deg in settings.pose_below_m_deg:
            columns[pose_column(m, deg)] = within(metres, degrees, m, deg)
    return columns | {auc_column(m): area_share(metres, m) for m in settings.auc_up_to_m}
