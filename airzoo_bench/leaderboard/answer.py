"""The published answer to a submission scored against a sealed truth."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.validation import Name, Strict
from airzoo_bench.results.result import ScoreColumn

__all__ = ["Estimate", "SealedAnswer"]

Finite = Annotated[float, Field(allow_inf_nan=False)]


class Estimate(Strict):
    """A score and its standard error, rounded as `sealed_scoring` says.

    The value is a multiple of `step`, None where it is infinite; None is an unknown error too.
    """

    value: Finite | None
    standard_error: Finite | None
    step: Finite | None = None


class SealedAnswer(Strict):
    """Scores of a sealed benchmark, coarse enough that no try tells the answer of one query.

    `truth_commitment` is SHA-256 over the truth and its salt, which lies in the archive; `scenes`
    are of earlier answers, which told scenes by themselves.
    """

    schema_version: Literal[1] = Field(alias="schema")
    sealed: Literal[True] = True
    track: str
    protocol: Name
    protocol_version: int
    protocol_fingerprint: str
    benchmark: Name
    truth_commitment: str
    method: str
    predictions_sha256: str
    columns: tuple[ScoreColumn, ...]
    queries: dict[str, int]
    scene_titles: dict[str, str]
    scenes: dict[str, dict[str, Estimate]] = Field(default_factory=dict)
    overall: dict[str, Estimate]
    versions: dict[str, str]
