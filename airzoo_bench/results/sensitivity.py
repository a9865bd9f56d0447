"""How scores move with the values that a truth assumes, and the noise floors that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from airzoo_bench.core.errors import ResultError, first_of
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Strict, validation_message
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.result import Result, ScoreColumn

__all__ = ["TOGETHER", "NoiseFloor", "Sensitivity", "read_noise_floor", "write_noise_floor"]

TOGETHER = "together"
"""The group of variants in which all assumed values are off at once."""

Floor = Annotated[float, Field(ge=0, allow_inf_nan=False)]

_MAKE = "make it with `airzoo-bench sensitivity BENCHMARK results... --out FILE`"


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """What moving the assumed values does to M methods by S scores in V variants.

    Attributes
    ----------
    methods : tuple of M str
    scores : tuple of S ScoreColumn
    groups : tuple of V str
        Which assumed value each variant has off, or `TOGETHER`.
    scenes : tuple of C str
    base : (C, M, S) array
        As scored, 0 to 1, by scene.
    values : (V, C, M, S) array
        The same in each variant, over the queries that a tile answers there.
    unanswerable : (V, C) int array
        Queries that no tile answers in a variant, and that are left out of it.
    """

    methods: tuple[str, ...]
    scores: tuple[ScoreColumn, ...]
    groups: tuple[str, ...]
    scenes: tuple[str, ...]
    base: Floats
    values: Floats
    unanswerable: np.ndarray[tuple[int, ...], np.dtype[np.int64]]

    @property
    def overall(self) -> Floats:
        """The unweighted means over scenes (V, M, S)."""
        means: Floats = self.values.mean(axis=1)
        return means

    @property
    def overall_base(self) -> Floats:
        """The unweighted means over scenes as scored, (M, S)."""
        means: Floats = self.base.mean(axis=0)
        return means

    def floors(self, scene: str | None = None) -> Floats:
        """Return the noise floor of differences between two methods, by score (S,).

        It is the largest change of a difference of two of the methods in any variant: a difference
        that is no larger could have the other sign if the assumed values were others.

        Parameters
        ----------
        scene : str, optional
            Of this scene, instead of the average over scenes.
        """
        place = None if scene is None else self.scenes.index(scene)
        base = self.overall_base if place is None else self.base[place]
        values = self.overall if place is None else self.values[:, place]
        change = values - base
        spread: Floats = change.max(axis=1) - change.min(axis=1)
        floors: Floats = spread.max(axis=0)
        return floors

    def ranks(self) -> tuple[Floats, Floats, Floats]:
        """Return the rank of each method by each score as scored, and its best and worst (M, S).

        Equal methods share the better rank.
        """
        found = _ranks(self.overall)
        return _ranks(self.overall_base), found.min(axis=0), found.max(axis=0)


def _ranks(values: Floats) -> Floats:
    """Rank methods (..., M, S), the highest first."""
    above = values[..., None, :, :] > values[..., :, None, :]
    ranks: Floats = 1.0 + above.sum(axis=-2)
    return ranks


class NoiseFloor(Strict):
    """What differences between methods must exceed, since the truth rests on assumed values.

    Attributes
    ----------
    protocol, protocol_fingerprint, truth_fingerprint : str
        What the results were scored by.
    ranges : dict of str to float
        How far each value was moved, see `retrieval.assumptions.AssumedRanges`.
    draws, seed : int
    methods : dict of str to str
        Whose differences were looked at: names, with the SHA-256 of their predictions.
    overall : dict of str to float
        Floors of the average over scenes by score, 0 to 1.
    scenes : dict of str to dict of str to float
        The same by scene.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    protocol: str
    protocol_fingerprint: str
    truth_fingerprint: str
    ranges: dict[str, Floor]
    draws: Annotated[int, Field(ge=0)]
    seed: Annotated[int, Field(ge=0)]
    methods: Annotated[dict[str, str], Field(min_length=2)]
    overall: dict[str, Floor]
    scenes: dict[str, dict[str, Floor]]

    def of(self, score: str, scene: str | None) -> float | None:
        """Return the floor of a score's differences, in a scene or on average; None if unknown."""
        floors = self.overall if scene is None else self.scenes.get(scene, {})
        return floors.get(score)

    def check_fits(self, results: Mapping[str, Result], path: Path) -> None:
        """Refuse floors of another protocol or truth than results by method, or of others.

        Raises
        ------
        ResultError
            They are.
        """
        result = next(iter(results.values()))
        ours = (self.protocol_fingerprint, self.truth_fingerprint)
        if ours != (result.protocol.fingerprint, result.truth.fingerprint):
            raise ResultError(
                f"noise floors of {self.protocol} on another protocol or truth than the results'",
                where=path,
                expected=f"{result.protocol.name}, protocol {result.protocol.fingerprint[:12]}, "
                f"truth {result.truth.fingerprint[:12]}",
                fix=_MAKE,
            )
        known = set(self.methods.values())
        others = [n for n, one in results.items() if one.predictions.sha256 not in known]
        if others:
            raise ResultError(
                f"noise floors of differences between {', '.join(self.methods)}, not of "
                f"{first_of(others, len(results))}",
                where=path,
                expected="floors that were made of all methods that are compared",
                fix=_MAKE,
            )


def write_noise_floor(path: Path, floor: NoiseFloor) -> None:
    """Write noise floors as JSON, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(floor.model_dump_json(by_alias=True, indent=1) + "\n")


def read_noise_floor(path: Path) -> NoiseFloor:
    """Read noise floors.

    Raises
    ------
    ResultError
        The file is missing or not what `write_noise_floor` writes.
    """
    if not path.exists():
        raise ResultError("no such file of noise floors", where=path, fix=_MAKE)
    try:
        return NoiseFloor.model_validate_json(read_text(path, ResultError, "file of noise floors"))
    except ValidationError as error:
        raise ResultError(
            f"no noise floors: {validation_message(error, NoiseFloor)}", where=path, fix=_MAKE
        ) from error
