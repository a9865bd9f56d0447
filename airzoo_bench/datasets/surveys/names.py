"""Which photo a row, a shot or an image of another program means."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import PurePosixPath

from airzoo_bench.core.errors import BenchmarkError, counted, first_of

__all__ = ["match_names"]


def _path(name: str) -> str:
    return name.replace("\\", "/").casefold()


def _base(name: str) -> str:
    return PurePosixPath(_path(name)).name


def _stem(name: str) -> str:
    return PurePosixPath(_base(name)).stem


_FORMS: tuple[Callable[[str], str], ...] = (str, _path, _base, _stem)


def match_names(given: Iterable[str], photos: Iterable[str], where: object) -> dict[str, str]:
    """Find the photo that each name means."""
    names, there = list(given), list(photos)
    tables = [_unique(form, there) for form in _FORMS]
    found = {}
    for name in names:
        hits = (table.get(form(name)) for form, table in zip(_FORMS, tables, strict=True))
        photo = next((hit for hit in hits if hit is not None), None)
        if photo is not None:
            found[name] = photo
    if not found:
        raise BenchmarkError(
            f"none of its {counted(len(names), 'name')} is among {counted(len(there), 'photo')}",
            where=where,
            expected=f"names such as {min(there, default='')!r}",
            fix=f"it has names such as {names[0]!r}: rename one or the other" if names else None,
        )
    twice = [photo for photo, count in Counter(found.values()).items() if count > 1]
    if twice:
        both = [name for name, photo in found.items() if photo == twice[0]]
        raise BenchmarkError(
            f"more than one name means {first_of(twice, len(there))}; the first is meant by "
            f"{' and '.join(map(repr, both[:3]))}",
            where=where,
            expected="each photo once",
        )
    return found


def _unique(form: Callable[[str], str], photos: list[str]) -> dict[str, str]:
    counts = Counter(map(form, photos))
    return {form(photo): photo for photo in photos if counts[form(photo)] == 1}
