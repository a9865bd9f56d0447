"""Long and wide tables alike: one field a printed number, with its names."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.errors import ResultError
from airzoo_bench.printed.grid import Grid
from airzoo_bench.printed.marks import plain_name, read_marked
from airzoo_bench.printed.scores import Family, read_score
from airzoo_bench.validation import nearest

__all__ = ["Field", "Layout", "fields_of"]

_IDS = ("table", "benchmark", "track", "scene", "method")
_LONG = ("method", "scene", "metric", "value")
_BESIDE = ("unit", "n", "bold", "gain", "printed_delta")
_KNOWN = tuple(dict.fromkeys((*_LONG, *_IDS, *_BESIDE)))
_WIDE = (*_IDS, "n")
_EXPECTED = "the columns method, scene, metric, value; or method, scene, and a column a score"
_UNIT = re.compile(r"(.*\S) ?[\[(](%|share|percent|m|cm|mm|km|px|deg|°)[\])]")
_NO_NUMBER = re.compile(r"[-–—\s]*|n/?a", re.IGNORECASE)


@dataclass(frozen=True)
class Field:
    """What the file says of one printed number.

    Attributes
    ----------
    path : Path
    line : int
    texts : mapping of str to str
        By the names of the columns of a long table.
    columns : mapping of str to str
        How the file calls them, where otherwise.
    """

    path: Path
    line: int
    texts: Mapping[str, str]
    columns: Mapping[str, str]

    def __getitem__(self, name: str) -> str:
        return self.texts.get(name, "")

    def where(self, name: str) -> str:
        """Return file, line and column, for messages."""
        return f"{self.path}, line {self.line}, column {self.columns.get(name, name)[:80]!r}"


@dataclass(frozen=True)
class Layout:
    """All fields, the columns that were not used, and whether a column says what is bold."""

    fields: tuple[Field, ...]
    unused: tuple[str, ...]
    has_bold: bool


def fields_of(path: Path, grid: Grid) -> Layout:
    """Return a field for every number of a long or a wide table.

    Raises
    ------
    ResultError
        A column is missing, mistyped, or there twice.
    """
    names = [plain_name(name) if grid.is_markup else name for name in grid.columns]
    folded = tuple(name.casefold() if name.casefold() in _KNOWN else name for name in names)
    _check_once(path, folded)
    is_wide = "method" in folded and not {"metric", "value"} & set(folded)
    if is_wide and set(folded) - set(_KNOWN):
        return _wide(path, grid, folded)
    missing = [name for name in _LONG if name not in folded]
    if missing:
        if "method" not in folded:
            _refuse_mistyped(path, [name for name in folded if name not in _KNOWN])
        raise ResultError(
            f"no column {', '.join(map(repr, missing))} (found: {_shown(grid.columns)})",
            where=path,
            expected=_EXPECTED,
            mend="put the names of the columns, separated by commas, into the first line "
            "(docs/audit.md)",
        )
    unused = [name for name in folded if name not in _KNOWN]
    _refuse_mistyped(path, unused)
    return _long(path, grid, folded, tuple(unused))


def _shown(columns: Sequence[str]) -> str:
    return ", ".join(columns)[:200] or "none"


def _check_once(path: Path, columns: Sequence[str]) -> None:
    twice = sorted({name for name in columns if columns.count(name) > 1})
    both = [name for name in ("gain", "printed_delta") if name in columns]
    if twice or len(both) > 1:
        names = " and ".join(repr(name[:80]) for name in twice or both)
        raise ResultError(f"{names}: one thing in two columns", where=path, mend="keep one")


def _refuse_mistyped(path: Path, names: Sequence[str]) -> None:
    for name in names:
        if hint := nearest(name.casefold(), list(_KNOWN)):
            raise ResultError(f"unknown column {name[:80]!r}{hint}", where=path, expected=_EXPECTED)


def _long(path: Path, grid: Grid, columns: tuple[str, ...], unused: tuple[str, ...]) -> Layout:
    fields = []
    for line, row in grid.rows:
        texts = {name: _one_line(text) for name, text in zip(columns, row, strict=True)}
        if grid.is_markup:
            texts |= {name: plain_name(texts[name]) for name in (*_IDS, "metric") if name in texts}
        texts["gain"] = texts.get("gain", "") or texts.pop("printed_delta", "")
        fields.append(Field(path, line, texts, {}))
    return Layout(tuple(fields), unused, "bold" in columns)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _wide(path: Path, grid: Grid, columns: tuple[str, ...]) -> Layout:
    if strange := [name for name in _BESIDE if name in columns and name != "n"]:
        raise ResultError(
            f"column {strange[0]!r} in a table of a line a method",
            where=path,
            expected="bold and gains in the fields themselves, as **96.21** (+1.73); units in the "
            "names of the columns, as R@1 [%]",
        )
    gains = {f"{name} gain": name for name in columns if f"{name} gain" in columns}
    others = [name for name in columns if name not in (*_WIDE, *gains)]
    scores = [name for name in others if _is_score(grid, columns.index(name), name)]
    unused = [name for name in others if name not in scores]
    _refuse_mistyped(path, unused)
    if not scores:
        raise ResultError(
            f"no column is a score (found: {_shown(grid.columns)})", where=path, expected=_EXPECTED
        )
    tidy = plain_name if grid.is_markup else _one_line
    fields = [
        field
        for line, row in grid.rows
        for field in _of_row(path, line, dict(zip(columns, row, strict=True)), scores, tidy)
    ]
    return Layout(tuple(fields), tuple(unused), has_bold=False)


def _is_score(grid: Grid, index: int, name: str) -> bool:
    """Whether a column's name is that of a score, or else all of it is numbers."""
    if read_score(_unit(name)[0]).family is not Family.OTHER:
        return True
    texts = [row[index] for _, row in grid.rows if not _NO_NUMBER.fullmatch(row[index])]
    return bool(texts) and not any(isinstance(read_marked(text), str) for text in texts)


def _unit(name: str) -> tuple[str, str]:
    """Split ``R@1 (%) ↑`` into name and unit."""
    plain = plain_name(name).strip("↑↓ ")
    found = _UNIT.fullmatch(plain)
    return (found[1], found[2].replace("°", "deg")) if found else (plain, "")


def _of_row(
    path: Path,
    line: int,
    row: Mapping[str, str],
    scores: Sequence[str],
    tidy: Callable[[str], str],
) -> list[Field]:
    names = {name: tidy(row[name]) for name in _WIDE if name in row}
    # A table without scenes is of one place, which stands for all there is.
    names.setdefault("scene", "overall")
    fields = []
    for name in scores:
        metric, unit = _unit(name)
        texts = {"metric": metric, "unit": unit, "value": _one_line(row[name])}
        texts["gain"] = _one_line(row.get(f"{name} gain", ""))
        columns = {"value": name, "gain": f"{name} gain", "unit": name, "metric": name}
        fields.append(Field(path, line, names | texts, columns))
    return fields
