"""Tables as benchmarks ship them: columns by name, whatever separates them, and checked numbers."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.datasets.native_text import read_native_text
from airzoo_bench.datasets.table_header import check_header, columns_text, found_columns
from airzoo_bench.geometry.arrays import Floats

__all__ = ["NativeTable", "read_lines", "read_table"]

_LIMIT_BYTES = 64 << 20
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_POINT = "write numbers with a decimal point, or separate the values by semicolons"


@dataclass(frozen=True, eq=False)
class NativeTable:
    """A table whose columns are known by name.

    Attributes
    ----------
    path : Path
    columns : tuple of str
        Those asked for that are there, as they were asked for.
    extra : tuple of str
        Further columns, as the file names them.
    rows : tuple of tuple of str
        The values of `columns`, without blanks around them.
    lines : tuple of int
        Line of the file of each row, counted from 1.
    decimal_commas : bool
        Whether numbers may have them: not where commas separate the values.
    """

    path: Path
    columns: tuple[str, ...]
    extra: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal_commas: bool = False

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def _by_name(self) -> dict[str, tuple[str, ...]]:
        values = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        return dict(zip(self.columns, values, strict=True))

    def texts(self, column: str) -> tuple[str, ...]:
        """Return the values of a column as they stand there."""
        return self._by_name[column]

    def numbers(
        self,
        column: str,
        least: float = -math.inf,
        most: float = math.inf,
        *,
        empty: bool = False,
    ) -> Floats:
        """Return the values of a column as numbers."""
        texts = self.texts(column)
        comma = self.decimal_commas and not any("." in text for text in texts)
        values = [_number(text, comma) for text in texts]
        for text, value, line in zip(texts, values, self.lines, strict=True):
            if not (least <= value <= most and math.isfinite(value)) and (text or not empty):
                raise BenchmarkError(
                    f"column {column}: {text[:40]!r}" if text else f"column {column} is empty",
                    where=f"{self.path}, line {line}",
                    expected=_range(least, most),
                    fix=_POINT if _DECIMAL_COMMA.fullmatch(text) else None,
                )
        return np.array(values, dtype=np.float64)

    def require_unique(self, column: str) -> None:
        """Refuse a value that two rows have."""
        counts = Counter(self.texts(column))
        twice = [value for value, count in counts.items() if count > 1]
        if twice:
            raise BenchmarkError(
                f"column {column}: several rows have {first_of(map(repr, twice), noun='value')}",
                where=self.path,
                expected="each once",
            )


def read_table(
    path: Path,
    columns: Sequence[str],
    optional: Collection[str] = (),
    limit_bytes: int = _LIMIT_BYTES,
    synonyms: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> NativeTable:
    """Read a table whose first line names its columns."""
    text = read_native_text(path, limit_bytes)
    head = text.lstrip().partition("\n")[0]
    separator = max(_SEPARATORS, key=lambda mark: len(found_columns(head.split(mark), columns)))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        parts = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise BenchmarkError(
            f"not a table: {error}", where=f"{path}, line {reader.line_num}"
        ) from error
    if not parts:
        raise BenchmarkError("is empty", where=path, expected=columns_text(columns, optional))
    header = [name.strip() for name in parts[0][1]]
    check_header(path, header, columns, optional, synonyms)
    places = found_columns(header, columns)
    for line, row in parts[1:]:
        _check_width(path, line, row, header, separator)
    return NativeTable(
        path,
        tuple(places),
        tuple(n for i, n in enumerate(header) if n and i not in places.values()),
        tuple(tuple(row[i].strip() for i in places.values()) for _, row in parts[1:]),
        tuple(line for line, _ in parts[1:]),
        decimal_commas=separator != ",",
    )


def read_lines(path: Path, columns: Sequence[str]) -> NativeTable:
    """Read lines of values separated by blanks, without a line that names them."""
    text = read_native_text(path, _LIMIT_BYTES)
    numbered = [(i, line.strip()) for i, line in enumerate(text.splitlines(), 1)]
    kept = [(i, line) for i, line in numbered if line and not line.startswith("#")]
    rows = [(i, line.rsplit(None, len(columns) - 1)) for i, line in kept]
    expected = f"{len(columns)} values in a line, separated by blanks: {' '.join(columns)}"
    for line, row in rows:
        if len(row) != len(columns):
            raise BenchmarkError(
                f"has {counted(len(row), 'value')}: {' '.join(row)[:60]!r}",
                where=f"{path}, line {line}",
                expected=expected,
            )
    if not rows:
        raise BenchmarkError("is empty", where=path, expected=expected)
    lines = tuple(line for line, _ in rows)
    return NativeTable(path, tuple(columns), (), tuple(tuple(row) for _, row in rows), lines)


def _check_width(path: Path, line: int, row: list[str], header: list[str], separator: str) -> None:
    few = len(row) < len(header)
    if not few and not any(map(str.strip, row[len(header) :])):
        return
    raise BenchmarkError(
        f"has {counted(len(row), 'value')} for {counted(len(header), 'column')}",
        where=f"{path}, line {line}",
        expected=f"{len(header)} values, separated by {_SEPARATORS[separator]}",
        fix="download the file again if it ends here" if few else _POINT,
    )


def _number(text: str, comma: bool) -> float:
    if comma and _DECIMAL_COMMA.fullmatch(text):
        text = text.replace(",", ".")
    try:
        # Python's own grouping of digits is no number here.
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


def _range(least: float, most: float) -> str:
    if math.isinf(least) and math.isinf(most):
        return "a number"
    if math.isinf(most):
        return f"a number, at least {least:g}"
    return f"a number from {least:g} to {most:g}"
