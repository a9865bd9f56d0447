"""Who was scored on what and when: a CSV file that only CI writes, counted by account ids."""

from __future__ import annotations

import csv
import datetime
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Literal, get_args

from airzoo_bench.core.errors import SubmissionError, counted
from airzoo_bench.leaderboard.board import Limits
from airzoo_bench.leaderboard.ci.git import RefusedError
from airzoo_bench.leaderboard.known import Place

__all__ = [
    "LEDGER_FILE",
    "Line",
    "Outcome",
    "check_tries",
    "owner",
    "parse_ledger",
    "write_ledger",
    "written_time",
]

LEDGER_FILE = "ledger.csv"

Outcome = Literal["started", "scored", "failed", "merged"]
_WHEN = "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True)
class Line:
    """A line of the ledger.

    Attributes
    ----------
    account : int
        By the number that stays when a name changes.
    head : str
        The commit that was scored.
    tree : str
        Git's id of the submission's folder in it, which a merge does not change.
    time : str
        In UTC.
    outcome : str
        ``started`` before a sealed truth is opened; then ``scored``, or ``failed`` by no fault of
        the submission, which gives the try back; ``merged`` makes the account the folder's owner.
    truth : str
        The truth's fingerprint; empty until it is known.
    """

    account: int
    benchmark: str
    track: str
    folder: str
    head: str
    time: str
    outcome: Outcome
    truth: str
    tree: str
    pull_request: int

    @property
    def place(self) -> Place:
        """The folder of the submission."""
        return Place(self.benchmark, self.track, self.folder)

    @property
    def when(self) -> datetime.datetime:
        """The time, with its time zone."""
        return datetime.datetime.strptime(self.time, _WHEN).replace(tzinfo=datetime.UTC)


_COLUMNS = tuple(field.name for field in fields(Line))


def written_time(now: datetime.datetime) -> str:
    """Return a time as the ledger has it."""
    return now.astimezone(datetime.UTC).strftime(_WHEN)


def parse_ledger(content: bytes | None) -> list[Line]:
    """Read a ledger; none has no lines."""
    if content is None:
        return []
    try:
        rows = list(csv.reader(io.StringIO(content.decode("utf-8"), newline="")))
        if not rows or tuple(rows[0]) != _COLUMNS:
            raise ValueError(f"its columns are not {', '.join(_COLUMNS)}")
        return [_line(row) for row in rows[1:]]
    except (ValueError, csv.Error) as error:
        raise SubmissionError(
            f"not a ledger: {error}",
            where=LEDGER_FILE,
            fix="put back what CI wrote: `git log` of the branch of the data has it",
        ) from error


def _line(row: Sequence[str]) -> Line:
    named = dict(zip(_COLUMNS, row, strict=True))
    if named["outcome"] not in get_args(Outcome):
        raise ValueError(f"no outcome is called {named['outcome']!r}")
    numbers = {name: int(named.pop(name)) for name in ("account", "pull_request")}
    line = Line(**named, **numbers)  # type: ignore[arg-type]
    datetime.datetime.strptime(line.time, _WHEN)  # refuses what is no time
    return line


def write_ledger(lines: Sequence[Line]) -> bytes:
    """Return the content of a ledger."""
    stream = io.StringIO(newline="")
    table = csv.DictWriter(stream, _COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(line) for line in lines)
    return stream.getvalue().encode()


def owner(lines: Sequence[Line], place: Place) -> int | None:
    """Return the account whose submission was the first to be merged in a folder."""
    merged = (ln.account for ln in lines if ln.outcome == "merged" and ln.place == place)
    return next(merged, None)


def check_tries(lines: Sequence[Line], new: Line, limits: Limits) -> None:
    """Refuse one more try than an account has on a sealed benchmark."""
    since = new.when - datetime.timedelta(days=limits.days)
    those = [ln for ln in lines if ln.account == new.account and ln.benchmark == new.benchmark]
    begun: dict[str, datetime.datetime] = {}
    answered = {line.head for line in those if line.outcome == "scored"}
    running: Counter[str] = Counter()
    for line in those:
        change = {"started": 1, "failed": -1}.get(line.outcome, 0)
        running[line.head] = max(0, running[line.head] + change)
    for line in those:
        if line.head in answered or running[line.head] > 0:
            begun.setdefault(line.head, line.when)
    counting = sorted(when for head, when in begun.items() if when > since and head != new.head)
    if len(counting) < limits.tries:
        return
    free = counting[-limits.tries] + datetime.timedelta(days=limits.days)
    raise RefusedError(
        f"this account has had {counted(len(counting), 'try', 'tries')} on {new.benchmark} within "
        f"{counted(limits.days, 'day')}",
        where=new.place.path,
        expected=f"at most {limits.tries}",
        fix=f"push again after {written_time(free)}",
    )
