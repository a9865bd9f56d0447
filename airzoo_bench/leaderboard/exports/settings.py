"""What a bundle for another platform scores, in ``scoring.json`` beside its scoring program."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import Name, Strict, validation_message
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.tables.method_table import as_shown

__all__ = [
    "FAILED",
    "SETTINGS_FILE",
    "WORST",
    "ExportColumn",
    "ScoringSettings",
    "finite",
    "fitted",
    "read_settings",
    "scoring_settings",
]

SETTINGS_FILE = "scoring.json"
FAILED = "failed"
WORST = 99999.0
"""What platforms show of an infinite error, and of a larger one: they take finite numbers only."""

_UNITS = {"share": "%", "m": "m", "deg": "°"}
_DIGITS = 6  # after the point; Codabench keeps ten
_HASH_LETTERS = 6


class ExportColumn(Strict):
    """A score as platforms know it.

    Attributes
    ----------
    key, title : str
        At most 36 characters, as Codabench wants it; all keys differ, and all titles.
    score : ScoreColumn
    """

    key: Annotated[str, Field(max_length=36)]
    title: Annotated[str, Field(max_length=36)]
    score: ScoreColumn


class ScoringSettings(Strict):
    """The content of ``scoring.json``.

    Attributes
    ----------
    columns : tuple of ExportColumn
        The first is what entries are sorted by.
    sealed : bool
        Whether the truth is secret, so that scores are told as coarsely as `sealed` tells them.
    """

    schema_version: Literal[1] = Field(alias="schema")
    protocol: Name
    track: str
    sealed: bool
    columns: Annotated[tuple[ExportColumn, ...], Field(min_length=1)]


def fitted(text: str, limit: int) -> str:
    """Shorten a text to so many characters, such that different ones stay different."""
    if len(text) <= limit:
        return text
    digest = hashlib.sha256(text.encode()).hexdigest()[:_HASH_LETTERS]
    return f"{text[: limit - _HASH_LETTERS - 1]}-{digest}"


def scoring_settings(protocol: Protocol, *, sealed: bool) -> ScoringSettings:
    """Say which scores of a protocol a platform shows: the headline, which all predictions have."""
    track: Any = TRACKS.get(protocol.track)
    shown = [score for score in score_columns(track.scores(protocol, ())) if score.headline]
    return ScoringSettings(
        schema=1,
        protocol=protocol.name,
        track=protocol.track,
        sealed=sealed,
        columns=tuple(map(_column, shown)),
    )


def _column(score: ScoreColumn) -> ExportColumn:
    title = f"{score.title} [{_UNITS[score.unit]}]"
    return ExportColumn(key=fitted(score.key, 36), title=fitted(title, 36), score=score)


def read_settings(path: Path) -> ScoringSettings:
    """Read a ``scoring.json``.

    Raises
    ------
    UsageError
        It is missing, or not as an export wrote it.
    """
    text = read_text(path, UsageError, "scoring file")
    try:
        return ScoringSettings.model_validate_json(text, strict=False)
    except ValidationError as error:
        raise UsageError(
            validation_message(error, ScoringSettings), where=path, fix="export the bundle again"
        ) from error


def finite(score: ScoreColumn, value: float) -> float:
    """Return a value as platforms take it: percent for a share, and at most `WORST`."""
    shown = value if math.isinf(value) else as_shown(score, value)
    return round(min(shown, WORST), _DIGITS)
