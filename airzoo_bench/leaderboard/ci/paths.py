"""Paths that strangers chose: bytes in git, and only plain names of them reach a disk."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Sequence

from airzoo_bench.leaderboard.ci.git import Entry, RefusedError
from airzoo_bench.leaderboard.names import fault_of_file_name
from airzoo_bench.leaderboard.predictions_given import DEPTH, RENAME

__all__ = ["check_entries", "checked_path", "shown_path"]

_KINDS = {
    "120000": "a symbolic link",
    "160000": "a submodule",
    "100755": "an executable file",
    "040000": "an empty folder",
}
_MEND = {"100755": "`git update-index --chmod=-x FILE`", "040000": "leave it out"}


def shown_path(path: bytes) -> str:
    """Return a path for messages: on one line, without bytes that are no text."""
    text = path.decode("utf-8", "backslashreplace")
    shown = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
    return shown if len(shown) <= 200 else f"{shown[:200]}..."


def checked_path(path: bytes) -> str:
    """Return a path as text."""
    try:
        text = path.decode("utf-8")
    except UnicodeDecodeError as error:
        raise RefusedError("the name is not UTF-8", where=shown_path(path), fix=RENAME) from error
    parts = text.split("/")
    for fault in (_fault_of_whole(text, parts), *map(fault_of_file_name, parts)):
        if fault:
            raise RefusedError(fault, where=shown_path(path), fix=RENAME)
    return text


def _fault_of_whole(text: str, parts: Sequence[str]) -> str:
    if text != unicodedata.normalize("NFC", text):
        return "the name is not in Unicode's normal form NFC"
    return f"lies in more than {DEPTH} folders" if len(parts) > DEPTH else ""


def check_entries(entries: Sequence[Entry]) -> list[RefusedError]:
    """Return what is wrong with names and kinds of files, a message each, at most 20."""
    found = [fault for entry in entries if (fault := _fault(entry)) is not None]
    if not found:
        found += _alike(entries)
    return found[:20]


def _fault(entry: Entry) -> RefusedError | None:
    if entry.mode != "100644":
        kind = _KINDS.get(entry.mode, f"of mode {entry.mode}")
        return RefusedError(
            f"is {kind}",
            where=shown_path(entry.path),
            expected="a plain file (mode 100644)",
            fix=_MEND.get(entry.mode, "commit the content itself"),
        )
    try:
        checked_path(entry.path)
    except RefusedError as fault:
        return fault
    return None


def _alike(entries: Sequence[Entry]) -> list[RefusedError]:
    """Find names that differ in case only, which are one file on other systems."""
    names = [entry.path.decode("utf-8") for entry in entries]
    times = Counter(name.casefold() for name in names)
    return [
        RefusedError("differs from another name only in case", where=name, fix="rename one of them")
        for name in names
        if times[name.casefold()] > 1
    ]
