"""The files of a submission: which may be there, their sizes, and the predictions among them."""

from __future__ import annotations

import os
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError, first_of
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard.addresses import WebAddress
from airzoo_bench.leaderboard.board import Limits
from airzoo_bench.leaderboard.names import fault_of_file_name
from airzoo_bench.leaderboard.submission import (
    CLAIMED_FILE,
    SUBMISSION_FILE,
    PredictionsGiven,
    Submission,
)

__all__ = [
    "DEPTH",
    "MOST_FILES",
    "RENAME",
    "check_entries",
    "check_folder",
    "find_predictions",
    "size_of_tree",
]

MOST_FILES = 2000
"""What a folder of a submission holds at most, with its folders."""
DEPTH = 12
"""The most parts that a path in the repository has."""
RENAME = "give it a name of A-Z, a-z, 0-9, _, . and -"
FETCHED = "fetched-predictions"
"""The folder in the data root that predictions at an address are kept in, by their hash."""


def check_folder(folder: Path, limits: Limits) -> Iterator[UserError]:
    """Yield what is wrong with the files of a submission, whatever they hold; none is opened."""
    count = size = 0
    pending, names = [folder], set[str]()
    while pending:
        for entry in sorted(os.scandir(pending.pop()), key=lambda one: one.name):
            found = entry.stat(follow_symlinks=False)
            count += 1
            if fault := _fault(Path(entry.path), found.st_mode, folder, names):
                yield fault
                return
            if stat.S_ISDIR(found.st_mode):
                pending.append(Path(entry.path))
            else:
                size += found.st_size
            if count > MOST_FILES:
                yield _too_many(folder)
                return
    if size > limits.committed_bytes:
        yield SubmissionError(
            f"its files take {size:,} bytes",
            where=folder,
            expected=f"at most {limits.committed_bytes:,} bytes in the repository of this board",
            fix="put the predictions where they can be fetched, and name them by url: "
            "`airzoo-bench submission new --url ...`",
        )


def _too_many(folder: Path) -> SubmissionError:
    return SubmissionError(
        f"holds more than {MOST_FILES:,} files and folders",
        where=folder,
        fix="put the predictions into one archive, such as predictions.zip",
    )


def _fault(path: Path, mode: int, folder: Path, names: set[str]) -> SubmissionError | None:
    if fault := _fault_of_name(path, folder, names):
        return SubmissionError(fault, where=path, fix=RENAME)
    if stat.S_ISDIR(mode):
        return None
    if not stat.S_ISREG(mode):
        return _no_plain_file(path)
    return _executable(path) if mode & stat.S_IXUSR and _has_modes(folder) else None


def _fault_of_name(path: Path, folder: Path, names: set[str]) -> str:
    """Say what is wrong with a path, if anything is; `names` are those seen before it."""
    inner = path.relative_to(folder).parts
    name = "/".join(inner).casefold()
    if name in names:
        return "differs from another name only in case"
    names.add(name)
    # Before it stand submissions, the benchmark, the track and the folder.
    too_deep = f"lies in more than {DEPTH} folders" if len(inner) + 4 > DEPTH else ""
    return fault_of_file_name(path.name) or too_deep


def _has_modes(folder: Path) -> bool:
    """Return whether git takes modes from this disk; on some every file is executable."""
    asked = ["git", "-C", str(folder), "config", "--type=bool", "--get", "core.fileMode"]
    try:
        return subprocess.run(asked, capture_output=True, check=False).stdout.strip() != b"false"
    except FileNotFoundError:
        return True


def _executable(path: Path) -> SubmissionError:
    return SubmissionError(
        "is an executable file",
        where=path,
        expected="a plain file",
        fix="`chmod -x FILE`, and `git add FILE` once more",
    )


def _no_plain_file(path: Path) -> SubmissionError:
    return SubmissionError(
        "a link, a pipe or a device, and no file",
        where=path,
        expected="plain files and folders",
        fix="copy there what it leads to",
    )


def check_entries(folder: Path, submission: Submission) -> Iterator[UserError]:
    """Yield an error where there is more in the folder than the submission speaks of."""
    given = submission.predictions
    spoken_of = {SUBMISSION_FILE, CLAIMED_FILE, given.file, given.names}
    strange = sorted(entry.name for entry in folder.iterdir() if entry.name not in spoken_of)
    if strange:
        yield SubmissionError(
            f"holds what submission.toml does not name: {first_of(strange, noun='entry')}",
            where=folder,
            expected=f"{SUBMISSION_FILE}, the predictions, {CLAIMED_FILE} (optional), and the list "
            "of names where predictions.names gives one",
            fix="remove it",
        )
    for key, name in {"file": given.file, "names": given.names}.items():
        if name is not None and not (folder / name).exists():
            yield SubmissionError(
                f"key 'predictions.{key}' is {name!r}, which is not there",
                where=folder,
                expected="a file, or a folder of predictions, next to submission.toml",
                fix="copy it there, or correct the key",
            )


def find_predictions(
    folder: Path,
    submission: Submission,
    limits: Limits,
    data: Path,
    *,
    fetch: bool,
    until: float | None = None,
) -> Path | None:
    """Return where the predictions lie, once they are known to be those announced."""
    given = submission.predictions
    if given.file is not None:
        path = folder / given.file
        if not path.exists():  # `check_entries` says so
            return None
    else:
        _check_url_size(given, limits)
        found = _fetched(given, data, fetch=fetch, until=until)
        if found is None:
            return None
        path = found
    _check_announced(path, given)
    return path


def _check_url_size(given: PredictionsGiven, limits: Limits) -> None:
    if given.size > limits.url_bytes:
        raise SubmissionError(
            f"key 'predictions.bytes' is {given.size:,}",
            where=SUBMISSION_FILE,
            expected=f"at most {limits.url_bytes:,}, the limit of this board",
            fix="write smaller predictions: fewer ranks, half precision, or compressed",
        )


def _fetched(
    given: PredictionsGiven, data: Path, *, fetch: bool, until: float | None
) -> Path | None:
    """Return the predictions at an address, once they are on this disk."""
    WebAddress.parse(str(given.url))  # what `fetch` would refuse is refused without a network too
    home = data / FETCHED / given.sha256
    if fetch:
        from airzoo_bench.leaderboard.fetching import fetch as fetch_now

        return fetch_now(str(given.url), home, size=given.size, sha256=given.sha256, until=until)
    # What begins with a dot is being fetched, or was when a run was stopped.
    kept = sorted(home.glob("[!.]*"))
    return kept[0] if kept else None


def size_of_tree(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files)


def _check_announced(path: Path, given: PredictionsGiven) -> None:
    size = size_of_tree(path)
    if size != given.size:
        what, announced, found = "bytes", f"{given.size:,}", f"{size:,}"
    else:
        sha256 = sha256_of_tree(path)
        if sha256 == given.sha256:
            return
        what, announced, found = "sha256", given.sha256, sha256
    raise SubmissionError(
        f"key 'predictions.{what}' is {announced}, but that of {path.name} is {found}",
        where=SUBMISSION_FILE,
        expected="the file that was announced, to the last byte",
        fix=f"write {what} = {found.replace(',', '')}, or put the right predictions there",
    )
