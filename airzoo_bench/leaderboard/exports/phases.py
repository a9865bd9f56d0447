"""When a competition takes submissions."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from airzoo_bench.core.errors import UsageError

__all__ = ["Phase", "read_phases"]

_NAME_LENGTH = 60


@dataclass(frozen=True)
class Phase:
    """A span of days, in UTC.

    Attributes
    ----------
    end : date or None
        The first day after it; none of one without end.
    """

    name: str
    start: datetime.date
    end: datetime.date | None

    @property
    def codename(self) -> str:
        """The name in small letters, digits and hyphens."""
        letters = (c if c.isascii() and c.isalnum() else "-" for c in self.name.lower())
        return "".join(letters).strip("-") or "phase"


def read_phases(texts: Sequence[str], *, endless: bool) -> list[Phase]:
    """Read phases, each ``NAME,START[,END]``, and hold them to follow each other.

    Parameters
    ----------
    texts : sequence of str
    endless : bool
        Whether the last need not end.

    Raises
    ------
    UsageError
        One is no such text, has no end, has the name of another, or begins before the one before
        it has ended.
    """
    phases = [_read(text) for text in texts]
    if not phases:
        raise UsageError("no phase is named", fix="add --phase NAME,START,END")
    if len({phase.codename for phase in phases}) < len(phases):
        raise UsageError("two phases have the same name", where="--phase")
    lasting = phases[:-1] if endless else phases
    for phase in lasting:
        if phase.end is None:
            raise UsageError(
                "the phase has no end", where=f"--phase {phase.name}", expected="NAME,START,END"
            )
    for earlier, later in pairwise(phases):
        # Codabench refuses a phase that begins the moment the one before it ends.
        if earlier.end is not None and later.start <= earlier.end:
            raise UsageError(
                f"the phase begins before {earlier.name} has ended",
                where=f"--phase {later.name}",
                expected=f"a day after {earlier.end}",
            )
    return phases


def _read(text: str) -> Phase:
    name, *days = (part.strip() for part in text.split(","))
    try:
        if len(days) not in (1, 2):
            raise ValueError(f"{len(days) + 1} parts, not two or three")
        start, *ends = map(datetime.date.fromisoformat, days)
        end = ends[0] if ends else None
        if not name or len(name) > _NAME_LENGTH or not name.isprintable():
            raise ValueError(f"its name has 1 to {_NAME_LENGTH} letters that are shown")
        if end is not None and end <= start:
            raise ValueError("ends before it begins")
    except ValueError as error:
        raise UsageError(
            f"the phase cannot be read ({error})",
            where=f"--phase {text}",
            expected="NAME,START or NAME,START,END, such as Test,2027-01-01,2027-03-01",
        ) from None
    return Phase(name, start, end)
