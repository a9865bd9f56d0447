"""The first line of a table: where columns are, and which of them are missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, agreeing
from airzoo_bench.core.validation import nearest

__all__ = ["check_header", "columns_text", "found_columns"]


def found_columns(header: Sequence[str], columns: Sequence[str]) -> dict[str, int]:
    """Return the places of the columns in a header, by the names asked for."""
    places = {name.strip().strip('"\ufeff').casefold(): i for i, name in enumerate(header)}
    return {name: places[name.casefold()] for name in columns if name.casefold() in places}


def check_header(
    path: Path,
    header: list[str],
    columns: Sequence[str],
    optional: Collection[str],
    synonyms: Mapping[str, Sequence[str]],
) -> None:
    """Refuse a header that lacks a column or has one twice; see `native_tables.read_table`."""
    counts = Counter(name.casefold() for name in header if name)
    twice = [name for name in columns if counts[name.casefold()] > 1]
    missing = [name for name in columns if not counts[name.casefold()] and name not in optional]
    if not twice and not missing:
        return
    unknown = [name for name in header if counts[name.casefold()] and name not in columns]
    lacks = f"lacks the {agreeing(len(missing), 'column', 'columns')}"
    what = "two columns are called" if twice else lacks
    meant = (f"{name}{_meant(name, unknown, synonyms.get(name, ()))}" for name in missing)
    names = ", ".join(twice or meant)
    raise BenchmarkError(
        f"{what} {names}; its first line is {', '.join(header)[:300]!r}",
        where=path,
        expected=columns_text(columns, optional),
        fix="keep one of them" if twice else "rename the column, or download the table again",
    )


def _meant(name: str, unknown: list[str], synonyms: Sequence[str]) -> str:
    """Offer the columns that a missing one may be: other words for it, else names like its own."""
    words = {word.casefold() for word in synonyms}
    other = [column for column in unknown if column.casefold() in words]
    return f" (did you mean {' or '.join(map(repr, other))}?)" if other else nearest(name, unknown)


def columns_text(columns: Sequence[str], optional: Collection[str]) -> str:
    """Say which columns are expected."""
    needed = ", ".join(name for name in columns if name not in optional)
    more = ", ".join(name for name in columns if name in optional)
    return f"a first line with the columns {needed}{f', and perhaps {more}' if more else ''}"
