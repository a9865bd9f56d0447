"""What stands above the columns of a wide table: scores, and scenes over or before them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from airzoo_bench.tables.printed.annotations import plain_name
from airzoo_bench.tables.printed.scores import is_known, is_plain_score

__all__ = ["ColumnTitle", "is_summary_name", "names_summary", "read_titles", "split_unit"]

_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total", "pooled"}
_UNIT = re.compile(r"(.*\S) ?[\[(](%|share|percent|m|cm|mm|km|px|deg|°)[\])]|(.*\w) (%)")
_LONGEST = 200
_COUNTED = re.compile(r"(.*\S) \((?:n ?= ?)?([0-9]{1,9})(?: queries)?\)", re.IGNORECASE)
# In brackets it is of a data set, as KITTI (2012).
_YEAR = re.compile(r"(?:19|20)[0-9]{2}")
# What our own tables write above the columns of a benchmark.
_BENCHMARK = re.compile(r".* v[0-9]{1,4}|.*, (?:retrieval|matching|reconstruction)")


@dataclass(frozen=True)
class ColumnTitle:
    """What one column holds.

    Attributes
    ----------
    column : str
        As the file calls it.
    scene : str
        Empty where the column does not say.
    benchmark : str
        Instead of the scene, where a protocol with its version is named.
    queries : str
        The number that stands in brackets behind the scene.
    """

    column: str
    metric: str
    unit: str
    scene: str = ""
    benchmark: str = ""
    queries: str = ""


def is_summary_name(scene: str) -> bool:
    """Whether a scene's name stands for several."""
    return scene.casefold() in _SUMMARIES


def read_titles(
    columns: Sequence[str], groups: Sequence[str], *, has_scenes: bool
) -> list[ColumnTitle]:
    """Tell what columns hold, by the names above them and by what these have in common.

    Parameters
    ----------
    columns : sequence of str
    groups : sequence of str
        What stands above each, one each.
    has_scenes : bool
        A column of the table says which scene a line is of: the titles name none.
    """
    titles = [_grouped(*pair) for pair in zip(columns, groups, strict=True)]
    if not has_scenes:
        titles = _with_scenes(titles)
    return [_counted(title) for title in titles]


def split_unit(name: str) -> tuple[str, str]:
    """Split ``R@1 (%) ↑`` into name and unit."""
    plain = plain_name(name)
    found = _UNIT.fullmatch(plain)
    if not found:
        return plain, ""
    return found[1] or found[3], (found[2] or found[4]).replace("°", "deg")


def _grouped(column: str, group: str) -> ColumnTitle:
    name, unit = split_unit(column)
    above, unit_above = split_unit(group)
    unit = unit or unit_above
    if not above:
        return ColumnTitle(column, name, unit)
    if is_plain_score(f"{above} {name}") and not is_plain_score(above):
        return ColumnTitle(column, f"{above} {name}", unit)
    if above.casefold() in ("recall", "r", "accuracy") and name.startswith("@"):
        return ColumnTitle(column, f"{above}{name}", unit)
    if not is_known(name) and is_plain_score(above):
        return ColumnTitle(column, above, unit, name)
    return ColumnTitle(column, name, unit, above)


def _with_scenes(titles: Sequence[ColumnTitle]) -> list[ColumnTitle]:
    """Split ``City R@1`` into scene and score, where the columns together say so.

    What stands before a score is a scene if some score is unknown with it, as ``City R@1``; or if
    the same score stands behind several such names, one of them for an average.
    """
    parts = [_split_scene(title) for title in titles]
    sure = {
        before
        for title, (before, _) in zip(titles, parts, strict=True)
        if not is_known(title.metric)
    }
    for metric in {after for before, after in parts if before}:
        befores = {before for before, after in parts if after == metric and before}
        if len(befores) > 1 and any(map(is_summary_name, befores)):
            sure |= befores
    return [
        replace(title, metric=after, scene=before) if before and before in sure else title
        for title, (before, after) in zip(titles, parts, strict=True)
    ]


def _split_scene(title: ColumnTitle) -> tuple[str, str]:
    """Return what stands before the longest known score that a name ends in, and that score."""
    name = title.metric
    if title.scene or len(name) > _LONGEST or is_plain_score(name):
        return "", name
    for space in re.finditer(" ", name):
        if is_plain_score(name[space.end() :]):
            return name[: space.start()], name[space.end() :]
    return "", name


def _counted(title: ColumnTitle) -> ColumnTitle:
    found = _COUNTED.fullmatch(title.scene)
    if found and not _YEAR.fullmatch(found[2]):
        title = replace(title, scene=found[1], queries=found[2])
    if _BENCHMARK.fullmatch(title.scene):
        return replace(title, benchmark=title.scene, scene="overall")
    return title


def names_summary(titles: Iterable[ColumnTitle]) -> bool:
    """Whether one of the scenes above the columns stands for several."""
    return any(title.scene and is_summary_name(title.scene) for title in titles)
