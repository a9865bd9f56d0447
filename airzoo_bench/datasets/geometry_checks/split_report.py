"""What two sets of photos share, as a table and as values."""

from __future__ import annotations

from airzoo_bench.core.errors import first_of
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.datasets.geometry_checks.split_overlap import SplitOverlap
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["split_table", "split_values"]


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
