"""Types of values that people write into protocol files."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

__all__ = ["SAFE_NAME", "Count", "Limits", "Name", "Positive", "Ranks", "Seed", "Strict"]

SAFE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"
"""Names that become folders, parts of ids and cells of tables."""


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if list(values) != sorted(set(values)):
        raise ValueError("must be ascending, without repeats")
    return values


Name = Annotated[str, Field(pattern=SAFE_NAME)]
Positive = Annotated[float, Field(gt=0, le=1e12, allow_inf_nan=False)]
"""Metres, pixels, degrees or seconds: larger ones are slips, and would overflow further on."""

Ranks = Annotated[
    tuple[Annotated[int, Field(ge=1, le=1000)], ...],
    Field(min_length=1, max_length=16),
    AfterValidator(_ascending),
]
Limits = Annotated[
    tuple[Positive, ...],
    Field(min_length=1, max_length=16),
    AfterValidator(_ascending),
]


Seed = Annotated[int, Field(ge=0, lt=2**31)]
Count = Annotated[int, Field(ge=1, le=10**9)]


class Strict(BaseModel):
    """A table of a file: no unknown key, no conversion of types, no change afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _arrays_are_tuples(cls, data: Any) -> Any:
        # TOML has arrays only; strict validation asks for the tuples that keep models immutable.
        if not isinstance(data, dict):
            return data
        return {key: _frozen(value) for key, value in data.items()}


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
