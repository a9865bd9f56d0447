"""Scoring a submission against a sealed truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.submission import Submission

__all__ = ["ToScore", "score_sealed"]


class ToScore(Protocol):
    """A submission that was checked, see `checks.CheckedSubmission`."""

    @property
    def submission(self) -> Submission:
        """What it states."""

    @property
    def predictions(self) -> Path | None:
        """Where its predictions lie."""


def score_sealed(
    checked: ToScore,
    archive: Path,
    key: Any,
    *,
    data: Path,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> SealedAnswer:
    """Score a submission, and tell of it what does not tell the truth.

    The truth is open while this runs, in memory where the system has files there, and is removed
    however it ends; see `unsealing.opened_truth`.

    Parameters
    ----------
    checked : CheckedSubmission
        Without errors, and with its predictions.
    archive : Path
        Of the truth, as `airzoo-bench seal` wrote it.
    key : pyrage.x25519.Identity
        See `keys.read_key`.
    data : Path
        The public benchmark folder that belongs to the archive, or the folder that holds it.
    resources : Resources

    Raises
    ------
    UserError
        The predictions are not as they must be, the key is not the archive's, the archive is
        damaged, or belongs to another public folder.
    """
    raise NotImplementedError
