"""Builds the board: a folder that appears whole, from runs, submissions and plain results.

What is computed of a result is kept in a folder beside the site, by the hash of its files: a build
does again what it cannot find there, and gives the same bytes with and without it.
"""

from __future__ import annotations

import gc
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import (
    atomic_folder,
    check_new_folder,
    only_writer,
)
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.leaderboard.site.api import as_json
from airzoo_bench.leaderboard.site.api_files import API_FOLDER, MARK, ApiFiles, Given
from airzoo_bench.leaderboard.site.downloads import downloads
from airzoo_bench.leaderboard.site.entries import (
    Entry,
    Faults,
    read_entries,
    result_entries,
    waiting,
)
from airzoo_bench.leaderboard.site.measured import Measured
from airzoo_bench.leaderboard.site.measuring import forget_others, measure_all
from airzoo_bench.leaderboard.site.pages import render_pages
from airzoo_bench.leaderboard.site.rows import Scored, slugs

__all__ = ["build_board"]

_OBJECTS = 500_000


def build_board(
    given: Given,
    out: Path,
    cache: Path,
    *,
    engine: Engine = HERE,
    note: Callable[[str], None] = print,
) -> Path:
    """Build the site, in place of an earlier one."""
    check_new_folder(out, replace=True, mark=MARK)
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        with only_writer(out), _few_collections():
            cache.mkdir(parents=True, exist_ok=True)
            files = _site(given, cache, engine, note)
            with atomic_folder(out, replace=True, mark=MARK) as folder:
                for path, content in files:
                    target = folder / path
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(content)
    except BlockingIOError as error:
        raise SubmissionError(
            "another build writes it", where=out, fix="wait until it has ended"
        ) from error
    return out


@contextmanager
def _few_collections() -> Iterator[None]:
    """Look for garbage less often: a board is a million objects, and nearly all of them stay."""
    usual = gc.get_threshold()
    gc.set_threshold(_OBJECTS, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def _site(
    given: Given, cache: Path, engine: Engine, note: Callable[[str], None]
) -> Iterator[tuple[str, bytes]]:
    made = ApiFiles(given, _methods(given, cache, engine, note), cache)
    values = as_json(made.files)
    for path, value in values.items():
        text = json.dumps(value, ensure_ascii=False, separators=(",", ":")) + "\n"
        yield path, text.encode()
    for one in made.tables:
        yield from downloads(one.table).items()
    yield from render_pages({p.removeprefix(API_FOLDER): v for p, v in values.items()}).items()


def _methods(
    given: Given, cache: Path, engine: Engine, note: Callable[[str], None]
) -> list[tuple[Scored, list[tuple[Entry, Measured]]]]:
    """Read and measure everything; each shown method with its earlier versions."""
    faults = Faults()
    entries = read_entries(given.runs, faults, note) + result_entries(given.results)
    faults.refuse()
    for line in waiting(given.submissions, entries):
        note(line)
    every = [one for entry in entries for one in (entry, *entry.older)]
    found = measure_all(every, cache, engine)
    forget_others(every, cache)
    faults.found += [one for one in found if isinstance(one, UserError)]
    faults.refuse()
    by_digest = {
        entry.digest: one for entry, one in zip(every, found, strict=True) if isinstance(one, tuple)
    }
    methods = [(entry, *by_digest[entry.digest]) for entry in entries]
    # One method may be on several protocols.
    plain = list(dict.fromkeys(m.method for entry, m, _ in methods if not entry.name))
    names = dict(
        zip(plain, slugs(plain, [entry.name for entry in entries if entry.name]), strict=True)
    )
    shown = [
        (
            Scored(entry.name or names[measured.method], entry, measured, array),
            [(old, by_digest[old.digest][0]) for old in entry.older],
        )
        for entry, measured, array in methods
    ]
    _check_names([one for one, _ in shown], faults)
    faults.refuse()
    return sorted(shown, key=lambda pair: (pair[0].id, pair[0].entry.digest))


def _check_names(methods: Iterable[Scored], faults: Faults) -> None:
    """Find two results of one method, and entries that are not where they say they belong."""
    known: dict[tuple[Any, ...], list[Scored]] = {}
    for one in methods:
        entry, measured = one.entry, one.measured
        same_name = known.setdefault((*measured.measures, one.method.casefold()), [])
        other = next((scored for scored in same_name if not _of_other_team(one, scored)), None)
        same_name.append(one)
        if other is not None:
            places = [scored.entry.place or str(scored.entry.file) for scored in (other, one)]
            faults.found.append(
                SubmissionError(
                    f"two results of {one.method} on {measured.protocol}",
                    where=" and ".join(places),
                    fix="remove one, or name it otherwise (`eval --method`); a new version of a "
                    "submission is the next number in its folder",
                )
            )
        if entry.submission is not None and entry.submission.protocol != measured.protocol:
            faults.found.append(
                SubmissionError(
                    f"scored by {measured.protocol}, but submitted for {entry.submission.protocol}",
                    where=entry.place,
                )
            )
        where = entry.place.split("/")[1:3]
        if where and where != [measured.benchmark, measured.track]:
            faults.found.append(
                SubmissionError(f"is of {measured.benchmark} ({measured.track})", where=entry.place)
            )


def _of_other_team(one: Scored, other: Scored) -> bool:
    """Whether both are submissions, of two teams: either has a row of the method's name."""
    first, second = one.entry.submission, other.entry.submission
    return first is not None and second is not None and first.team != second.team
