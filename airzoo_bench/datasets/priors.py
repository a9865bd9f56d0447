"""Priors: a table that gives them, how far they are from poses, and which photos have none."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.datasets.photo_facts import median
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "PRIOR_VALUES",
    "TURNED_DEG",
    "PriorFacts",
    "WithoutPrior",
    "prior_facts",
    "read_prior_file",
    "without_prior",
]

PRIOR_VALUES = ("lon", "lat", "altitude_m", "yaw_deg", "pitch_deg", "roll_deg")
_LIMITS = {"lon": 180.0, "lat": 90.0}
_LIMIT_BYTES = 64 << 20


def read_prior_file(path: Path, photos: Iterable[str]) -> dict[str, dict[str, float]]:
    """Read a CSV with the column ``image`` and some of `PRIOR_VALUES`."""
    text = read_text(path, BenchmarkError, "table of priors", _LIMIT_BYTES)
    try:
        table = csv.DictReader(io.StringIO(text.removeprefix("\ufeff")), strict=True)
        rows, names = list(table), list(table.fieldnames or ())
    except csv.Error as error:
        raise BenchmarkError(f"not a CSV: {error}", where=path) from error
    columns = set(rows[0]) if rows else set()
    known = "image" in columns and columns <= {"image", *PRIOR_VALUES}
    if not known or len(set(names)) < len(names):
        shown = names if known else map(str, sorted(columns, key=str))
        raise BenchmarkError(
            f"has the columns {', '.join(shown)}",
            where=path,
            expected=f"image, and some of {', '.join(PRIOR_VALUES)}, each once",
        )
    names = [row["image"] for row in rows]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    _refuse_names(twice, "named twice", path)
    there = set(photos)
    _refuse_names([name for name in names if name not in there], "no photos", path)
    return {row["image"]: _values(row, number, path) for number, row in enumerate(rows, start=2)}


def _values(row: dict[str, str], line: int, path: Path) -> dict[str, float]:
    found = {}
    for name in PRIOR_VALUES:
        text = (row.get(name) or "").strip()
        if not text:
            continue
        try:
            value = math.nan if "_" in text else float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= _LIMITS.get(name, 1e6):
            raise BenchmarkError(
                f"column {name}, line {line}: {text[:40]!r}",
                where=path,
                expected=f"a number, at most {_LIMITS[name]:g} either way"
                if name in _LIMITS
                else "a number",
                fix="look whether lon and lat are swapped" if name == "lat" else None,
            )
        found[name] = value
    return found


def _refuse_names(names: list[str], what: str, path: Path) -> None:
    if names:
        raise BenchmarkError(
            f"{what}: {first_of(map(repr, names))}",
            where=path,
            expected="each photo once, by its name relative to the folder of the photos",
        )


TURNED_DEG = 45.0
"""No gimbal is so far off; a mistake of convention is."""


@dataclass(frozen=True)
class PriorFacts:
    """Median errors of the priors, and the ids of photos whose prior is turned."""

    photos: int
    position_m: float
    yaw_deg: float
    pitch_deg: float
    rotation_deg: float
    turned: tuple[str, ...]


@dataclass(frozen=True)
class WithoutPrior:
    """Photos that have no prior.

    Attributes
    ----------
    photos : int
        All of the scene.
    lacking : dict of str to tuple of str
        Their ids by what they lack: the first of position, altitude, gimbal angles.
    some_word : bool
        Whether any photo of the scene says something of its position or angles.
    """

    photos: int
    lacking: dict[str, tuple[str, ...]]
    some_word: bool

    @property
    def count(self) -> int:
        """How many have none."""
        return sum(map(len, self.lacking.values()))


def prior_facts(photos: pd.DataFrame) -> PriorFacts | None:
    """Compare priors with poses; None where no photo has a prior."""
    there = photos[_with_prior(photos)]
    if there.empty:
        return None
    priors, poses = poses_of(there, PRIOR_COLUMNS), poses_of(there)
    position, yaw, pitch, rotation = prior_errors(priors, poses)
    turned = tuple(there["id"][rotation > TURNED_DEG])
    medians = median(position), median(yaw), median(pitch), median(rotation)
    return PriorFacts(len(there), *medians, turned)


def without_prior(photos: pd.DataFrame, metadata: Mapping[str, PhotoPrior] | None) -> WithoutPrior:
    """Find the photos that have no prior, and what each lacks; without metadata, of the table."""
    lacking: dict[str, list[str]] = {}
    if metadata is None:
        ids = tuple(photos["id"][~_with_prior(photos)])
        return WithoutPrior(len(photos), {"whole row in --priors": ids} if ids else {}, False)
    said = [metadata.get(name, PhotoPrior()) for name in photos["image"]]
    for one, prior, there in zip(photos["id"], said, _with_prior(photos), strict=True):
        if not there and not prior.is_complete:
            lacking.setdefault(_first_lacking(prior), []).append(one)
    some_word = any((prior.lon, prior.yaw_deg) != (None, None) for prior in said)
    found = {what: tuple(ids) for what, ids in lacking.items()}
    return WithoutPrior(len(photos), found, some_word)


def _with_prior(photos: pd.DataFrame) -> Bools:
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return np.zeros(len(photos), dtype=bool)
    whole: Bools = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    return whole


def _first_lacking(prior: PhotoPrior) -> str:
    if prior.lon is None:
        return "GPS position"
    return "altitude" if prior.altitude_m is None else "gimbal angles"


def prior_errors(priors: Poses, poses: Poses) -> tuple[Floats, Floats, Floats, Floats]:
    """Compare N priors with the poses."""
    # Rows of a rotation are the camera's axes in the world: this takes the pose's to the prior's.
    between = np.einsum("nki,nkj->nij", priors.rotation, poses.rotation)
    sine, cosine = between[:, 1, 0] - between[:, 0, 1], between[:, 0, 0] + between[:, 1, 1]
    down = [np.degrees(np.arcsin(np.clip(p.rotation[:, 2, 2], -1, 1))) for p in (priors, poses)]
    return (
        np.sqrt(((priors.centres - poses.centres) ** 2).sum(axis=-1)),
        np.abs(np.degrees(np.arctan2(sine, cosine))),
        np.abs(down[0] - down[1]),
        rotation_angle_deg(priors.rotation, poses.rotation),
    )
