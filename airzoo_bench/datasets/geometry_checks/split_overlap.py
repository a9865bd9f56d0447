"""Whether two sets of photos, such as training and test, see the same ground.

Two footprints overlap where they share an area; to touch is not to overlap.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import agreeing, counted, first_of
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.geometry_checks.footprint_sets import NamedFootprints
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.tables.model import Cell, Column, Row, Table

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Overlaps",
    "SplitOverlap",
    "compare_splits",
    "find_overlaps",
    "split_table",
    "split_values",
]

_BLOCK = 2048
_SHOWN = 20
_METRES_OF_A_DEGREE = np.pi / 180 * 6_371_008.8
_LEAST_AREA_M2 = 1e-4  # what rounding makes of borders that touch: 1e-9 degrees by 1 km


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Pairs of footprints that share an area.

    Attributes
    ----------
    train, test : (P,) int64 arrays
        Rows of the two sets.
    area_m2 : (P,) float64
        What they share.
    share : (P,) float64
        Of the test footprint.
    """

    train: Ints
    test: Ints
    area_m2: Floats
    share: Floats


@dataclass(frozen=True, eq=False)
class SplitOverlap:
    """What two sets share.

    Attributes
    ----------
    train, test : NamedFootprints
    pairs : int
        How many overlap.
    tainted : int
        How many photos of the test set overlap one of the training set.
    first : list of (train id, test id, shared m², share of the test footprint)
        The first 20 pairs, in the order of the test set.
    """

    train: NamedFootprints
    test: NamedFootprints
    pairs: int
    tainted: int
    first: list[tuple[str, str, float, float]]

    @property
    def unknown(self) -> list[str]:
        """Photos of either set whose footprint is not known."""
        sets = (self.train, self.test)
        return [s.ids[row] for s in sets for row in np.flatnonzero(s.unknown)]

    @property
    def passes(self) -> bool:
        """Whether nothing overlaps, and all footprints are known."""
        return self.pairs == 0 and not self.unknown


def find_overlaps(train: Floats, test: Floats, progress: Progress = silent) -> Iterator[Overlaps]:
    """Find the pairs of footprints that share an area, block by block of the test set."""
    from shapely import STRtree

    shapes, rows = _polygons(*_with_copies(train, test))
    tree = STRtree(shapes)
    starts = range(0, len(test), _BLOCK)
    for start in progress(starts, "footprints", len(starts)):
        lonlat = _unwrapped(test[start : start + _BLOCK])
        asked, kept = _polygons(lonlat, np.arange(start, start + len(lonlat)))
        found_test, found_train = tree.query(asked, predicate="intersects")
        for part in _parts(len(found_test)):
            yield _overlaps(
                asked[found_test[part]],
                shapes[found_train[part]],
                kept[found_test[part]],
                rows[found_train[part]],
            )


def compare_splits(
    train: NamedFootprints,
    test: NamedFootprints,
    *,
    csv: Path | None = None,
    progress: Progress = silent,
) -> SplitOverlap:
    """Look for ground that both sets see."""
    count, tainted = 0, np.zeros(len(test.ids), dtype=bool)
    first: list[tuple[str, str, float, float]] = []
    with nullcontext() if csv is None else atomic_write(csv, "w") as stream:
        if stream is not None:
            stream.write("train,test,shared_m2,share_of_test\n")
        for found in find_overlaps(train.lonlat, test.lonlat, progress):
            count += len(found.test)
            tainted[found.test] = True
            if stream is not None or len(first) < _SHOWN:
                table = _named(found, train, test)
                first += list(table.head(_SHOWN - len(first)).itertuples(index=False, name=None))
                _append(table, stream)
    return SplitOverlap(train, test, count, int(tainted.sum()), first)


def _append(table: pd.DataFrame, stream: IO[Any] | None) -> None:
    if stream is not None:
        table.to_csv(stream, index=False, header=False, lineterminator="\n")


def _named(found: Overlaps, train: NamedFootprints, test: NamedFootprints) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(
        {
            "train": [train.ids[row] for row in found.train],
            "test": [test.ids[row] for row in found.test],
            "shared_m2": np.round(found.area_m2, 3),
            "share_of_test": np.round(found.share, 6),
        }
    )


def _overlaps(asked: Any, shapes: Any, test: Ints, train: Ints) -> Overlaps:
    import shapely

    shared = shapely.intersection(asked, shapes)
    # Degrees of longitude shrink with the latitude of what is shared.
    latitude = np.radians(shapely.get_y(shapely.centroid(asked)))
    square = _METRES_OF_A_DEGREE**2 * np.cos(latitude)
    area = shapely.area(shared) * square
    whole = shapely.area(asked) * square
    order = np.lexsort((train, test))
    order = order[area[order] > _LEAST_AREA_M2]
    share = area[order] / whole[order]
    return Overlaps(train[order], test[order], area[order], share)


def _parts(count: int) -> Iterator[slice]:
    for start in range(0, count, 1 << 18):
        yield slice(start, start + (1 << 18))


def _polygons(lonlat: Floats, rows: Ints) -> tuple[Any, Ints]:
    """Return shapes of the footprints that there are, and their rows."""
    import shapely

    from airzoo_bench.retrieval.footprints import untangled

    there = np.isfinite(lonlat).all(axis=(1, 2))
    return shapely.polygons(untangled(lonlat[there])), rows[there]


def _unwrapped(lonlat: Floats) -> Floats:
    """Unwrap the corners of each footprint about its first, which is put within +-180 degrees."""
    lon = lonlat[..., 0]
    first = (lon[:, :1] + 180.0) % 360.0 - 180.0
    lon = first + (lon - lon[:, :1] + 180.0) % 360.0 - 180.0
    return np.stack((lon, lonlat[..., 1]), axis=-1)


def _with_copies(lonlat: Floats, other: Floats) -> tuple[Floats, Ints]:
    """Unwrap, and repeat all a turn away where either set reaches across the 180th meridian."""
    unwrapped, turn = _unwrapped(lonlat), np.array((360.0, 0.0))
    across = any((np.abs(found[..., 0]) > 180.0).any() for found in (unwrapped, _unwrapped(other)))
    copies = (unwrapped, unwrapped - turn, unwrapped + turn) if across else (unwrapped,)
    return np.concatenate(copies), np.tile(np.arange(len(lonlat)), len(copies))


def split_table(found: SplitOverlap) -> Table:
    """Lay out the first pairs that overlap, with the counts below."""
    columns = (
        Column("Training photo"),
        Column("Test photo"),
        Column("Shared", "m²", decimals=1),
        Column("Of the test photo", "%", decimals=2),
    )
    rows = tuple(
        Row((Cell(train), Cell(test), Cell(area), Cell(100 * share)))
        for train, test, area, share in found.first
    )
    return Table("Ground that both sets see", columns, rows, tuple(_notes(found)))


def _notes(found: SplitOverlap) -> list[str]:
    sizes = f"{len(found.train.ids):,} training and {counted(len(found.test.ids), 'test photo')}"
    notes = [f"{sizes}: no two see the same ground"]
    if found.pairs:
        overlap = f"{counted(found.pairs, 'pair')} {agreeing(found.pairs, 'overlaps', 'overlap')}"
        notes = [f"{sizes}: {overlap}, with {found.tainted:,} of the test photos"]
    if found.pairs > len(found.first):
        notes.append(f"the first {len(found.first)} are shown; --out writes all")
    if found.unknown:
        notes.append(f"it is not known where photos look: {first_of(found.unknown)}")
    return notes


def split_values(found: SplitOverlap) -> dict[str, object]:
    """Return the same as JSON values."""
    keys = ("train", "test", "shared_m2", "share_of_test")
    return {
        "passes": found.passes,
        "train_photos": len(found.train.ids),
        "test_photos": len(found.test.ids),
        "overlapping_pairs": found.pairs,
        "test_photos_that_overlap": found.tainted,
        "first_pairs": [dict(zip(keys, pair, strict=True)) for pair in found.first],
        "not_known": found.unknown,
    }
