"""The reproduction ledger: printed numbers beside those that were scored here, and why they differ.

A printed method and one of the board are the same where they have one name, or where
``reproductions.toml`` at the root of the board's repository says so; it also says why they differ::

    schema = 1

    [[reproduction]]
    protocol = "uav-visloc-retrieval"
    method = "SALAD (our weights)"
    printed = "SALAD"
    why = "The paper cuts tiles at 1 m per pixel, the protocol at 0.3 m."
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Name, Strict, nearest, read_toml, validated
from airzoo_bench.leaderboard.site.api import Number, Reproduction, Row, Score, TableFile
from airzoo_bench.leaderboard.site.measured import OVERALL

__all__ = ["REPRODUCTIONS_FILE", "Link", "find_reproductions", "read_links"]

REPRODUCTIONS_FILE = "reproductions.toml"
_ROUNDING = 1e-9

Halves = Mapping[tuple[str, str, str], float]

Line = Annotated[str, Field(min_length=1, max_length=120)]


class Link(Strict):
    """Two methods that are one, and why their numbers differ.

    Attributes
    ----------
    method : str
        As the board has it.
    printed : str or None
        As the source has it, where that is another name.
    """

    protocol: Name
    method: Line
    printed: Line | None = None
    why: Annotated[str, Field(max_length=2000)] = ""

    @property
    def whose(self) -> str:
        """The printed method's name."""
        return self.printed or self.method


class _Links(Strict):
    schema_version: Literal[1] = Field(alias="schema")
    reproduction: Annotated[tuple[Link, ...], Field(max_length=10_000)] = ()


def read_links(path: Path) -> tuple[Link, ...]:
    """Read a reproductions.toml; none where there is no such file.

    Raises
    ------
    SubmissionError
        It is no TOML, or has missing, unknown or malformed keys.
    """
    if not path.is_file():
        return ()
    data = read_toml(path, SubmissionError, "file of reproductions")
    return validated(data, _Links, SubmissionError, path, "file of reproductions").reproduction


def find_reproductions(
    table: TableFile,
    scenes: dict[str, dict[str, dict[str, Score]]],
    links: Sequence[Link],
    halves: Halves,
) -> list[Reproduction]:
    """Put every printed number beside the one that was scored here.

    Parameters
    ----------
    table : TableFile
    scenes : dict of str to dict of str to dict of str to Score
        By row, scene and score.
    links : sequence of Link
        Those of the table's protocol are used.
    halves : mapping of (method, scene, score) to float
        Half the last digit of printed numbers, which stand for all that they are the rounding of.

    Raises
    ------
    SubmissionError
        A link names no method of the table.
    """
    own = [link for link in links if link.protocol == table.protocol]
    scored = _by_method(table, "re-scored", "sealed")
    printed = _by_method(table, "reported")
    for link in own:
        _check(link.method, scored, "was scored here", table)
        _check(link.whose, printed, "is printed", table)
    pairs = {(name, name): "" for name in scored if name in printed}
    pairs |= {(link.method, link.whose): link.why for link in own}
    return [
        one
        for (name, whose), why in pairs.items()
        for mine in scored[name]
        for theirs in printed[whose]
        for one in _of_pair(table, scenes, mine, theirs, why, halves)
    ]


def _by_method(table: TableFile, *kinds: str) -> dict[str, list[Row]]:
    """Return the rows of each method: several teams may have scored it."""
    found: dict[str, list[Row]] = {}
    for row in table.rows:
        if row.kind in kinds:
            found.setdefault(row.method, []).append(row)
    return found


def _check(name: str, rows: dict[str, list[Row]], what: str, table: TableFile) -> None:
    if name not in rows:
        raise SubmissionError(
            f"no method {name!r} {what} on {table.protocol}{nearest(name, list(rows))}",
            where=REPRODUCTIONS_FILE,
            expected="one of " + ", ".join(rows) if rows else None,
        )


def _of_pair(
    table: TableFile,
    scenes: dict[str, dict[str, dict[str, Score]]],
    own: Row,
    reported: Row,
    why: str,
    halves: Halves,
) -> list[Reproduction]:
    parts = {OVERALL: (own.scores, reported.scores)} | {
        scene: (scenes.get(own.id, {}).get(scene, {}), numbers)
        for scene, numbers in scenes.get(reported.id, {}).items()
    }
    return [
        Reproduction(
            table.id,
            own.method,
            own.id,
            f"{reported.method} ({reported.source})"
            if reported.method != own.method
            else reported.source,
            scene,
            key,
            printed.value,
            printed.text,
            mine[key].value,
            mine[key].text,
            mine[key].low,
            mine[key].high,
            _within(printed.value, mine[key], halves.get((reported.method, scene, key), 0.0)),
            own.team,
            own.rescored,
            why,
        )
        for scene, (mine, theirs) in parts.items()
        for key, printed in theirs.items()
        if key in mine and printed.value is not None
    ]


def _within(printed: Number, mine: Score, half: float) -> bool | None:
    """Tell whether anything that rounds to a printed number lies in an interval."""
    if mine.low is None or mine.high is None or printed is None:
        return None
    reach = half + _ROUNDING
    return float(mine.low) - reach <= float(printed) <= float(mine.high) + reach
