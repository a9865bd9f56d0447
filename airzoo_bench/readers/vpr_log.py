"""What info.log of VPR-methods-evaluation says of a run."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.files import first_bytes

__all__ = ["VprLog", "read_log"]

_MOST_BYTES = 1 << 20  # of the beginning, where the arguments stand
_TEXT = r"""('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")"""
_COUNTS = re.compile(r"#queries: (\d{1,12}); #database: (\d{1,12})")


@dataclass(frozen=True)
class VprLog:
    """A log folder, with what its log says; None where that is not there.

    Attributes
    ----------
    folder : Path
    method : str or None
    database, queries : str or None
        The folders of images.
    counts : (int, int) or None
        Queries and database images.
    only_wrong : bool
        Whether lists of rightly answered queries were left out.
    labels : bool
        Whether names of images begin with positions, which decide their order.
    """

    folder: Path
    method: str | None = None
    database: str | None = None
    queries: str | None = None
    counts: tuple[int, int] | None = None
    only_wrong: bool = False
    labels: bool = False

    @property
    def folders(self) -> tuple[str, ...]:
        """Paths that may name the scene of the run."""
        return (str(self.folder), self.database or "", self.queries or "")


def read_log(folder: Path) -> VprLog:
    """Read the arguments of a run, as Python prints them, and its counts of images."""
    text = first_bytes(folder / "info.log", _MOST_BYTES).decode("utf-8", "replace")
    begin = text.rfind("Namespace(")
    arguments = text[begin:].split("\n", 1)[0] if begin >= 0 else ""
    counts = _COUNTS.search(text)
    return VprLog(
        folder,
        _argument(arguments, "method"),
        _argument(arguments, "database_folder"),
        _argument(arguments, "queries_folder"),
        (int(counts[1]), int(counts[2])) if counts else None,
        "save_only_wrong_preds=True" in arguments,
        "use_labels=True" in arguments,
    )


def _argument(arguments: str, name: str) -> str | None:
    found = re.search(rf"[(\s]{name}={_TEXT}", arguments)
    if found is None:
        return None
    try:
        value = ast.literal_eval(found[1])
    except (SyntaxError, ValueError):
        return None
    return value if isinstance(value, str) and "\0" not in value else None
