"""What stands in a field as a number of the paper: its digits, unit, marks and gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.annotations import (
    Marked,
    is_no_number,
    plain_name,
    read_loosely,
    read_marked,
)
from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.grid import Field
from airzoo_bench.tables.printed.numbers import Rounded
from airzoo_bench.tables.printed.scores import Family, Score, read_score

__all__ = ["read_cell", "readable"]

_PERCENT = {"%", "percent"}
_FULL = {"share": 1, "1": 1} | dict.fromkeys(_PERCENT, 100)
_BOLD = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False, "": False}
_MOST_QUERIES = 1_000_000_000


def readable(fields: Sequence[Field]) -> tuple[list[Field], list[str]]:
    """Leave out columns that hold what is no number, and fields that hold words.

    Their tables are told to be incomplete, so that no average is compared with the rest.

    Returns
    -------
    fields : list of Field
    notes : list of str
        What was left out, and what was read without what follows the number.
    """
    words = [f for f in fields if not is_no_number(f["value"]) and not _has_digit(f["value"])]
    marked = [f for f in fields if _has_digit(f["value"])]
    unread = [f for f in marked if _loosely(f) is None]
    loose = [f for f in marked if isinstance(read_marked(f["value"]), str)]
    gone = {_column(field) for field in unread}
    silent = set(map(id, words))
    kept = [field for field in fields if _column(field) not in gone and id(field) not in silent]
    if gone:
        kept = [replace(field, texts={**field.texts, "partial": "1"}) for field in kept]
    read = [field for field in loose if _column(field) not in gone]
    return kept, [
        f"{what}: {_example(found)}"
        for what, found in (
            ("columns left out for a field that is no printed number", unread),
            ("fields without a number, left out", words),
            ("read without what follows the number", read),
        )
        if found
    ]


def _example(fields: Sequence[Field]) -> str:
    first = fields[0]
    more = f" and {len(fields) - 1} more" if len(fields) > 1 else ""
    return f"{first['value'][:40]!r} in line {first.line}{more}"


def _has_digit(text: str) -> bool:
    return any(sign.isdigit() for sign in plain_name(text))


def _column(field: Field) -> tuple[str, ...]:
    return field["benchmark"], field["scene"], field["metric"], field.columns.get("value", "")


def _loosely(field: Field) -> Marked | None:
    marked = read_marked(field["value"])
    return read_loosely(field["value"]) if isinstance(marked, str) else marked


def read_cell(field: Field, *, strict: bool) -> PrintedValue | None:
    """Read one printed number with its marks; None for an empty field, a dash and the like.

    Parameters
    ----------
    field : Field
    strict : bool
        Refuse what follows a number; else leave footnotes and deviations out.

    Raises
    ------
    ResultError
        A name is missing, or the field is no printed number.
    """
    for name in ("method", "metric"):
        if not field[name]:
            raise ResultError(f"no {name}", where=field.where(name), expected="a name")
    if is_no_number(field["value"]):
        return None
    loose = None if strict else _loosely(field)
    marked = loose or _marked(field)
    score = _directed(read_score(field["metric"]), field["arrow"])
    unit = field["unit"] or ("%" if marked.percent else "")
    return PrintedValue(
        line=field.line,
        table=field["table"],
        benchmark=field["benchmark"],
        track=field["track"],
        scene=field["scene"],
        method=field["method"],
        score=score,
        unit=unit,
        full=_full(field, score, unit),
        number=marked.number,
        gain=_gain(field, marked),
        bold=_bold(field, marked),
        queries=_queries(field),
        may_average=field.may_average,
        section=field.row.section if field.row else 0,
        competes=not marked.muted,
        partial=bool(field["partial"]),
    )


def _directed(score: Score, arrow: str) -> Score:
    """Believe the arrow of a score that may be several things: no distance is better high."""
    rises = arrow == "↑"
    if not arrow or score.family not in (Family.OTHER, Family.ACCURACY, Family.COMPLETENESS):
        return score
    if score.higher_is_better is rises:
        return score
    return replace(score, family=Family.OTHER, higher_is_better=rises)


def _marked(field: Field, name: str = "value") -> Marked:
    marked = read_marked(field[name])
    if isinstance(marked, str):
        raise ResultError(
            marked,
            where=field.where(name),
            expected="a number as printed, such as 96.21, 96.21%, **96.21** or 96.21 (+1.73)",
            fix="leave deviations and footnotes out; a dash stands for no number",
        )
    return marked


def _gain(field: Field, marked: Marked) -> Rounded | None:
    if is_no_number(field["gain"]):
        return marked.gain
    given = _marked(field, "gain").number
    if marked.gain and marked.gain.value != given.value:
        raise ResultError(
            f"gain {given.text} here and {marked.gain.text} next to the value",
            where=field.where("gain"),
            fix="keep one",
        )
    return given


def _full(field: Field, score: Score, unit: str) -> int:
    if not score.is_share:
        return 1
    if unit and unit.casefold() not in _FULL:
        raise ResultError(
            f"unit {unit[:80]!r} for {score.name[:80]!r}, a {score.family.value}",
            where=field.where("unit"),
            expected="% or share",
        )
    return _FULL[unit.casefold() or "%"]


def _bold(field: Field, marked: Marked) -> bool | None:
    if "bold" not in field.texts:
        return marked.bold or None
    text = field["bold"].casefold()
    if text not in _BOLD:
        raise ResultError(
            f"bold is {field['bold'][:80]!r}", where=field.where("bold"), expected="1 or 0"
        )
    return marked.bold or _BOLD[text]


def _queries(field: Field) -> int | None:
    text = field["n"]
    if is_no_number(text):
        return None
    if not (text.isascii() and text.isdigit() and 0 < int(text[:12]) <= _MOST_QUERIES):
        raise ResultError(
            f"n is {text[:80]!r}",
            where=field.where("n"),
            expected="the number of queries of the scene",
        )
    return int(text)
