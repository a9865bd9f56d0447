"""What the titles of scores mean, in a few words."""

from __future__ import annotations

import re

from airzoo_bench.results.result import ScoreColumn

__all__ = ["meaning"]

_SHARE = "share of queries"
_AP = "average precision of the first {0} tiles, "
_VARIANTS = {
    "min": "over the positives that can be among them",
    "trec": "over all positives",
    "hits": "over the positives found",
}
_MEANINGS: dict[str, tuple[tuple[str, str], ...]] = {
    "retrieval": (
        (r"recall@1", f"{_SHARE} whose first tile answers"),
        (r"recall@(\d+)", f"{_SHARE} with a tile that answers among the first {{0}}"),
        (r"ap@(\d+)", "share of the first {0} tiles that answer the query"),
        *((rf"ap@(\d+)/{name}", _AP + said) for name, said in _VARIANTS.items()),
        (r"map", "average precision of the whole list, over all positives"),
        (r"mrr", "one over the rank of the first tile that answers"),
        (r"ndcg@(\d+)", "gain of the first {0} tiles, less at later ranks, over the best possible"),
        (r"distance_m", "median distance from the first tile to what the photo shows"),
        (r"distance<(.+)m", f"{_SHARE} whose first tile is nearer than {{0}} m"),
        (r"sdm@(\d+)", "nearness of the first {0} tiles in metres, weighted by rank"),
        (r"pdm@(\d+)", "nearness of the first {0} tiles in tile sizes, weighted by rank"),
    ),
    "matching": (
        (r"error_m", "median distance from the camera's true place; infinite without a pose"),
        (r"within_([^_]+)m", f"{_SHARE} posed within {{0}} m"),
        (r"within_([^_]+)m_(.+)deg", f"{_SHARE} posed within {{0}} m and {{1}}°"),
        (r"horizontal_m", "median horizontal distance from the camera's true place"),
        (r"vertical_m", "median vertical distance from the camera's true place"),
        (r"rotation_deg", "median angle from the camera's true orientation"),
        (r"auc_(.+)m", f"mean {_SHARE} posed within a distance, over all up to {{0}} m"),
    ),
    "reconstruction": (
        (r"chamfer_m", "mean of accuracy and completeness"),
        (r"accuracy_m", "mean distance from made points to true ones"),
        (r"completeness_m", "mean distance from true points to made ones"),
        (r"accuracy_median_m", "median distance from made points to true ones"),
        (r"completeness_median_m", "median distance from true points to made ones"),
        (r"precision_(.+)m", "share of made points nearer than {0} m to a true one"),
        (r"recall_(.+)m", "share of true points nearer than {0} m to a made one"),
        (r"f1_(.+)m", "harmonic mean of precision and recall at {0} m"),
        (r"pose_auc_(.+)deg", "mean share of camera pairs within an angle, over all up to {0}°"),
        (r"cameras_placed", "share of the photos that have a pose; the next three are over those"),
        (r"ate_m", "distance of aligned camera centres from the true ones"),
        (r"rpe_m", "error of the way from one camera to the next"),
        (r"rpe_deg", "error of the turn from one camera to the next"),
    ),
}


def meaning(track: str, score: ScoreColumn) -> str:
    """Say what a score is, for who does not know its title; empty where that is not known here."""
    for pattern, words in _MEANINGS.get(track, ()):
        if found := re.fullmatch(pattern, score.key):
            return words.format(*found.groups())
    return ""
