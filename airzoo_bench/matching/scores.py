"""Scores of the matching track, and the columns of the records that they are taken from."""

from __future__ import annotations

from functools import partial

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.matching.metrics import PoseErrors, area_share, within
from airzoo_bench.matching.settings import MatchingScores
from airzoo_bench.results.scores import Score


def matching_scores(settings: MatchingScores) -> list[Score]:
    """Return the scores that a protocol asks for."""
    error = partial(Score, higher_is_better=False, average="median")
    share = Score.share
    scores = [error("error_m", "Median", "m", headline=True)]
    for m in settings.translation_below_m:
        scores.append(share(translation_column(m), f"@{m:g}m", headline=True))
    for m, deg in settings.pose_below_m_deg if settings.orientation_is_trusted else ():
        scores.append(share(_pose_column(m, deg), f"@{m:g}m,{deg:g}°", headline=True))
    scores += [error("horizontal_m", "Horizontal", "m"), error("vertical_m", "Vertical", "m")]
    if settings.orientation_is_trusted:
        scores.append(error("rotation_deg", "Rotation", "deg"))
    return scores + [share(f"auc_{m:g}m", f"AUC@{m:g}m") for m in settings.auc_up_to_m]


def translation_column(limit_m: float) -> str:
    """Name the column of translation recall."""
    return f"within_{limit_m:g}m"


def _pose_column(limit_m: float, limit_deg: float) -> str:
    return f"within_{limit_m:g}m_{limit_deg:g}deg"


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
    for m in settings.translation_below_m:
        columns[translation_column(m)] = within(metres, None, m)
    for m, deg in settings.pose_below_m_deg if settings.orientation_is_trusted else ():
        columns[_pose_column(m, deg)] = within(metres, degrees, m, deg)
    return columns | {f"auc_{m:g}m": area_share(metres, m) for m in settings.auc_up_to_m}
