"""What is told of a submission that was scored against a sealed truth."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.validation import Name, Strict
from airzoo_bench.results.result import ScoreColumn

__all__ = ["Estimate", "SealedAnswer"]

Finite = Annotated[float, Field(allow_inf_nan=False)]


class Estimate(Strict):
    """A score and its standard error, rounded as `sealed.rounding` says.

    Attributes
    ----------
    value : float or None
        A multiple of `step`; None where it is infinite.
    standard_error : float or None
        One digit, rounded upward; None where it is infinite or not known.
    step : float or None
        Half of the standard error, or more where few queries make the score; None where the value
        is.
    """

    value: Finite | None
    standard_error: Finite | None
    step: Finite | None = None


class SealedAnswer(Strict):
    """Scores of a sealed benchmark, coarse enough that no try tells the answer of one query.

    Attributes
    ----------
    truth_commitment : str
        SHA-256 over the truth and its salt, which lies in the archive.
    queries : dict of str to int
        Of each scene; that is public.
    scenes : dict of str to dict of str to Estimate
        By scene and score; scenes of fewer than `rounding.LEAST_QUERIES` queries are left out, and
        count in `overall`.
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
    scenes: dict[str, dict[str, Estimate]]
    overall: dict[str, Estimate]
    versions: dict[str, str]
