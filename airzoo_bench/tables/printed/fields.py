"""Long and wide tables alike: one field a printed number, with its names."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.validation import nearest
from airzoo_bench.tables.printed.annotations import arrow, is_no_number, plain_name, read_marked
from airzoo_bench.tables.printed.column_titles import (
    ColumnTitle,
    names_summary,
    read_titles,
    split_unit,
)
from airzoo_bench.tables.printed.grid import METHOD_NAMES, Field, Grid, GridRow, Layout
from airzoo_bench.tables.printed.scores import is_known

__all__ = ["fields_of"]

_IDS = ("table", "benchmark", "track", "scene", "method")
_LONG = ("method", "scene", "metric", "value")
_BESIDE = ("unit", "n", "bold", "gain", "printed_delta")
_KNOWN = tuple(dict.fromkeys((*_LONG, *_IDS, *_BESIDE)))
_WIDE = (*_IDS, "n")
_EXPECTED = "the columns method, scene, metric, value; or method, scene, and a column a score"
# What papers, and our own tables, call these columns.
_ALSO = dict.fromkeys(METHOD_NAMES, "method") | {"queries": "n"}
_MENDS = {
    "CSV": "put the names of the columns, separated by commas, into the first line",
    "Markdown": "put the names of the columns into the line above the rule",
    "LaTeX": "put the names of the columns into the row above the first numbers, as "
    "Method & Scene & R@1 \\\\",
}
# In the corner, as Method \ Scene, what stands below it and what next to it.
_ACROSS = re.compile(r"([a-z]+) ?[\\/|] ?[a-z ]+")
_UNNAMED = "(unnamed)"
_MOST_BESIDE = 6


def fields_of(path: Path, grid: Grid) -> Layout:
    """Return a field for every number of a long or a wide table.

    Raises
    ------
    ResultError
        A column is missing, mistyped, or there twice.
    """
    folded = _named_first(grid, _folded(grid))
    _check_once(path, grid, folded)
    if "value" not in folded and set(folded) - set(_KNOWN):
        if "metric" in folded and _are_scores(grid, folded):
            return _by_metric(path, grid, folded)
        if "method" in folded:
            return _wide(path, grid, folded)
        if "scene" in folded and any(_is_score_title(name) for name in folded):
            return _wide(path, grid, folded)
    missing = [name for name in _LONG if name not in folded]
    if missing:
        lacking = f"column {', '.join(map(repr, missing))}"
        if grid.is_markup and len(missing) == len(_LONG):
            lacking = "column of methods and no known score"
        elif "method" not in folded:
            _refuse_mistyped(path, [name for name in folded if name not in _KNOWN])
        raise ResultError(
            f"no {lacking} (found: {_shown(grid)})",
            where=path,
            expected=_EXPECTED,
            fix=_MENDS[grid.kind] + " (docs/audit.md)",
        )
    unused = [name for name in folded if name not in _KNOWN]
    _refuse_mistyped(path, unused)
    return _long(path, grid, folded, tuple(unused))


def _folded(grid: Grid) -> tuple[str, ...]:
    """Return the names of the columns, those that are known in small letters."""
    names = [plain_name(name) if grid.is_markup else name for name in grid.columns]
    small = [name.strip().casefold() for name in names]
    if "method" not in small and small and not small[0] and not {"metric", "value"} & set(small):
        small[0] = "method"
    corners = [found[1] if (found := _ACROSS.fullmatch(name)) else name for name in small]
    also = [_ALSO.get(c, name) for c, name in zip(corners, small, strict=True)]
    free = [a if also.count(a) == 1 else s for a, s in zip(also, small, strict=True)]
    return tuple(f if f in _KNOWN else name for f, name in zip(free, names, strict=True))


def _named_first(grid: Grid, columns: tuple[str, ...]) -> tuple[str, ...]:
    """Take the first column of a laid out table of scores for that of the methods."""
    known = {"method", "scene", "value"} & set(columns)
    titles = read_titles(columns[1:], grid.groups[1:], has_scenes=False)
    if not grid.is_markup or known or not any(is_known(title.metric) for title in titles):
        return columns
    return ("method", *columns[1:])


def _are_scores(grid: Grid, columns: Sequence[str]) -> bool:
    """Whether a column of metrics holds names of scores, and no title is one."""
    at = columns.index("metric")
    names = {plain_name(row.texts[at]) for row in grid.rows} - {""}
    over_columns = any(map(_is_score_title, columns))
    return bool(names) and all(map(_is_score_title, names)) and not over_columns


def _by_metric(path: Path, grid: Grid, columns: tuple[str, ...]) -> Layout:
    """Read a line a score: the other columns are scenes, or methods where none names these."""
    over = "scene" if "method" in columns else "method"
    rows, notes = _filled(grid, columns, "metric")
    places = [i for i, name in enumerate(columns) if name not in _KNOWN]
    fields = []
    for row in rows:
        ids = {n: plain_name(t) for n, t in zip(columns, row.texts, strict=True) if n in _KNOWN}
        label = {"table": grid.label} if grid.label else {}
        metric, unit = split_unit(ids["metric"])
        for i in places:
            name = " ".join(filter(None, (grid.groups[i], columns[i])))
            own = {"metric": metric, "unit": unit, "value": row.texts[i], over: name}
            texts = {"scene": "overall"} | label | ids | own
            fields.append(Field(path, row.line, texts, {"value": columns[i]}, row=row))
    return Layout(tuple(fields), (), False, notes)


def _is_score_title(name: str) -> bool:
    return any(is_known(title.metric) for title in read_titles([name], [""], has_scenes=True))


def _shown(grid: Grid) -> str:
    names = map(plain_name, grid.columns) if grid.is_markup else grid.columns
    return ", ".join(names)[:200] or "none"


def _check_once(path: Path, grid: Grid, columns: Sequence[str]) -> None:
    pairs = list(zip(grid.groups, columns, strict=True))
    twice = sorted({name for group, name in pairs if pairs.count((group, name)) > 1})
    both = [name for name in ("gain", "printed_delta") if name in columns]
    if twice or len(both) > 1:
        names = " and ".join(repr(name[:80]) for name in twice or both)
        raise ResultError(f"{names}: one thing in two columns", where=path, fix="keep one")


def _refuse_mistyped(path: Path, names: Sequence[str]) -> None:
    for name in names:
        if hint := nearest(name.casefold(), list(_KNOWN)):
            raise ResultError(f"unknown column {name[:80]!r}{hint}", where=path, expected=_EXPECTED)


def _long(path: Path, grid: Grid, columns: tuple[str, ...], unused: tuple[str, ...]) -> Layout:
    fields = []
    rows, notes = _filled(grid, columns)
    for row in rows:
        texts = dict(zip(columns, row.texts, strict=True))
        if grid.is_markup:
            texts |= {name: plain_name(texts[name]) for name in (*_IDS, "metric") if name in texts}
        texts["gain"] = texts.get("gain", "") or texts.pop("printed_delta", "")
        fields.append(Field(path, row.line, texts, {}))
    return Layout(tuple(fields), unused, "bold" in columns, notes)


def _filled(
    grid: Grid, columns: Sequence[str], *others: str
) -> tuple[list[GridRow], tuple[str, ...]]:
    """Return the rows, with the name above where a field for one is empty, and what was so read.

    In a table that is laid out for readers an empty scene is the one above too.
    """
    repeated = ["method", "scene", *others] if grid.is_markup else ["method"]
    above = dict.fromkeys((name for name in repeated if name in columns), "")
    filled: list[int] = []
    rows = []
    for row in grid.rows:
        texts = [_one_line(text) for text in row.texts]
        for name in above:
            index = columns.index(name)
            if not texts[index] and above[name]:
                texts[index] = above[name]
                filled.append(row.line)
            above[name] = texts[index]
        rows.append(replace(row, texts=tuple(texts)))
    lines = ", ".join(map(str, dict.fromkeys(filled)))
    note = f"an empty name is read as the one above it: line {lines}" if filled else ""
    return rows, (note,) if note else ()


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
    further = {f"{name} {what}" for name in columns for what in ("gain", "from", "to")}
    places = [
        index
        for index, name in enumerate(columns)
        if name not in (*_WIDE, *(further - {f"{group} gain" for group in grid.groups if group}))
    ]
    titles = read_titles(
        [columns[i] for i in places],
        [grid.groups[i] for i in places],
        has_scenes="scene" in columns,
    )
    scores = {i: h for i, h in zip(places, titles, strict=True) if _is_score(grid, i, h)}
    unused = [columns[i] for i in places if i not in scores]
    if not grid.is_markup:
        _refuse_mistyped(path, unused)
    if not scores:
        texts = (row.texts[i] for row in grid.rows for i in places)
        odd = next((f", in which {t[:40]!r} is not one number" for t in texts if "/" in t), "")
        raise ResultError(
            f"no column is a score (found: {_shown(grid)}{odd})", where=path, expected=_EXPECTED
        )
    rows, notes = _filled(grid, columns)
    fields = [field for row in rows for field in _of_row(path, row, columns, scores, grid)]
    return Layout(tuple(fields), tuple(unused), False, notes)


def _is_score(grid: Grid, index: int, title: ColumnTitle) -> bool:
    """Whether a column's name is that of a score, or else all of it is numbers."""
    if is_known(title.metric):
        return True
    texts = [row.texts[index] for row in grid.rows if not is_no_number(row.texts[index])]
    return bool(texts) and not any(isinstance(read_marked(text), str) for text in texts)


def _of_row(
    path: Path, row: GridRow, columns: Sequence[str], scores: Mapping[int, ColumnTitle], grid: Grid
) -> list[Field]:
    tidy: Callable[[str], str] = plain_name if grid.is_markup else _one_line
    said = list(zip(columns, row.texts, strict=True))
    names = {name: tidy(text) for name, text in said if name in _WIDE}
    # A table of one method need not name it; one without scenes is of one place, all there is.
    names.setdefault("method", _UNNAMED)
    names.setdefault("scene", "overall")
    if grid.label:
        names.setdefault("table", grid.label)
    loose = not names_summary(scores.values())
    known = {i for i, title in scores.items() if is_known(title.metric)}
    extra = tuple(
        (name, tidy(text))
        for i, (name, text) in enumerate(said)
        if i not in known and name not in _WIDE
    )[:_MOST_BESIDE]
    arrows = {i: arrow(grid.columns[i]) for i in scores}
    fields = []
    for index, title in scores.items():
        name = columns[index]
        gain = row.texts[columns.index(f"{name} gain")] if f"{name} gain" in columns else ""
        above = {"scene": title.scene, "benchmark": title.benchmark, "n": title.queries}
        texts = {
            "metric": title.metric,
            "unit": title.unit,
            "value": row.texts[index],
            "gain": gain,
        }
        texts |= {key: text for key, text in above.items() if text} | {"arrow": arrows[index]}
        called = {"value": name, "gain": f"{name} gain", "unit": name, "metric": name}
        averages = bool(title.scene) and loose and not title.queries
        fields.append(Field(path, row.line, names | texts, called, averages, row, extra))
    return fields
