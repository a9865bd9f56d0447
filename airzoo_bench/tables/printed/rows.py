"""Rows of one table that bear the same name: what stands above or next to them tells them apart."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from airzoo_bench.tables.printed.annotations import is_no_number, plain_name
from airzoo_bench.tables.printed.cells import grouped
from airzoo_bench.tables.printed.grid import Field

__all__ = ["told_apart", "without_differences"]

_SIGNED = re.compile(r"[\s{$(]*(?:[+−–-]|--|↑|↓|\\uparrow|\\downarrow)")
_RISING = re.compile(r"[\s{$(]*(?:\+|↑|\\uparrow)")
_DIFFERENCE = re.compile(
    r"(?:Δ|∆|delta|improvement|gain|difference|diff|relative|absolute|vs)\b.*|Δ|∆", re.IGNORECASE
)


def without_differences(fields: Sequence[Field]) -> tuple[list[Field], list[int]]:
    """Leave out rows of differences between other rows, and return their lines."""
    lines = grouped(fields, lambda field: field.line)
    dropped = [line for line, own in lines.items() if _are_differences(own)]
    gone = set(dropped)
    return [field for field in fields if field.line not in gone], dropped


def _are_differences(fields: Sequence[Field]) -> bool:
    values = [plain_name(f["value"]) for f in fields if not is_no_number(f["value"])]
    if not values or not all(map(_SIGNED.match, values)):
        return False
    name = plain_name(fields[0]["method"])
    return any(map(_RISING.match, values)) or bool(_DIFFERENCE.match(name))


def told_apart(fields: Sequence[Field]) -> tuple[list[Field], str]:
    """Tell rows of one name apart by the titles above them, then by what else their lines say.

    Parameters
    ----------
    fields : sequence of Field
        All of one table.

    Returns
    -------
    fields : list of Field
        As they were where no two are alike, or nothing tells these apart.
    note : str
        What was done; empty for nothing.
    """
    if not _repeats(fields):
        return list(fields), ""
    titled = [_titled(field) for field in fields]
    if not _repeats(titled):
        return titled, "what stands above rows of one name, from side to side, is their scene"
    for start in (titled, list(fields)):
        made, alike = start, _alike(start)
        used: list[str] = []
        for column in dict.fromkeys(name for field in fields for name, _ in field.extra):
            longer = [
                _joined(field, column) if first["method"] in alike else field
                for first, field in zip(start, made, strict=True)
            ]
            if _count(longer) > _count(made):
                made = longer
                used.append(column)
            if not _repeats(made):
                return made, f"rows of one name are told apart by {', '.join(used)}"
    return list(fields), ""


def _identity(field: Field) -> tuple[str, ...]:
    return tuple(field[n] for n in ("table", "benchmark", "track", "scene", "method", "metric"))


def _count(fields: Iterable[Field]) -> int:
    return len(set(map(_identity, fields)))


def _repeats(fields: Sequence[Field]) -> bool:
    return max(Counter(map(_identity, fields)).values(), default=0) > 1


def _alike(fields: Sequence[Field]) -> set[str]:
    """Return the methods that several rows have."""
    counts = Counter(map(_identity, fields))
    return {field["method"] for field in fields if counts[_identity(field)] > 1}


def _titled(field: Field) -> Field:
    """Take the title for the scene, or where column titles name scenes, for the benchmark."""
    title = plain_name(field.row.title) if field.row else ""
    if not title:
        return field
    key = "scene" if field["scene"] == "overall" else "benchmark"
    return replace(field, texts={**field.texts, key: title}, may_average=True)


def _joined(field: Field, column: str) -> Field:
    text = dict(field.extra).get(column, "")
    if not text or is_no_number(text):
        return field
    return replace(field, texts={**field.texts, "method": f"{field['method']}, {text}"})
