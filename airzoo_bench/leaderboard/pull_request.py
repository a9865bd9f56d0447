"""Pull requests: they may change one submission, in one folder, which is their author's own."""

from __future__ import annotations

import json
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.board import Board, Place
from airzoo_bench.leaderboard.checks import DEPTH, RENAME
from airzoo_bench.leaderboard.git import BoardError, Entry, RefusedError, Repository
from airzoo_bench.leaderboard.names import fault_of_file_name
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE

__all__ = [
    "BASE",
    "HEAD",
    "PullRequest",
    "Touched",
    "fetch_pull_request",
    "read_event",
    "read_files",
    "submitted",
    "touched",
]

HEAD, BASE = "refs/heads/head", "refs/heads/base"

_MOST_TOML_BYTES = 100_000
_MOST_FAULTS = 20
_LFS = b"version https://git-lfs.github.com/spec/"
_KINDS = {
    "120000": ("a symbolic link", "commit the content itself"),
    "160000": ("a submodule", "commit the content itself"),
    "100755": ("an executable file", "`git update-index --chmod=-x FILE`"),
    "040000": ("an empty folder", "leave it out"),
}


@dataclass(frozen=True)
class PullRequest:
    """The parts of a pull request that count.

    `head` is the commit to score, and no other; `base` the branch that it is to be merged into;
    `account` its author, by the number that stays when a name changes.
    """

    number: int
    head: str
    base: str
    account: int


def read_event(path: Path) -> PullRequest:
    """Read the event of a pull request, as GitHub writes it."""
    try:
        pull = json.loads(read_text(path, SubmissionError, "event"))["pull_request"]
        found = PullRequest(
            int(pull["number"]), str(pull["head"]["sha"]), str(pull["base"]["ref"]),
            int(pull["user"]["id"]),
        )  # fmt: skip
        if set(found.head) - set("0123456789abcdef") or len(found.head) not in (40, 64):
            raise ValueError("head.sha is no commit")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise SubmissionError(
            f"not the event of a pull request: {error!r}"[:200],
            where=path,
            expected="the file $GITHUB_EVENT_PATH of a pull_request_target event",
        ) from error
    return found


@dataclass(frozen=True)
class Touched:
    """The one submission that a pull request changes.

    `tree` is git's id of its folder at the head, empty where the pull request removes it.
    """

    place: Place
    tree: str


def fetch_pull_request(repository: Repository, pull: PullRequest) -> None:
    """Fetch head and base, without the files' content."""
    refs = {f"refs/pull/{pull.number}/head": HEAD, f"refs/heads/{pull.base}": BASE}
    repository.fetch(refs, blobs=False)
    if not repository.contains(HEAD, pull.head):
        raise BoardError(
            f"the commit {pull.head[:12]} is no longer part of pull request {pull.number}",
            fix="nothing: the newer commit is scored by its own run",
        )


def touched(
    repository: Repository, pull: PullRequest, board: Board, former_owner: Owner
) -> Touched | None:
    """Return the submission that a pull request changes; None where it changes none.

    `former_owner` returns the account of a folder that is no longer on the board.
    """
    base = _merge_base(repository, pull)
    now, before = (repository.resolve(f"{commit}:submissions") for commit in (pull.head, base))
    if now == before:  # its other changes are none of a board's business
        return None
    place = _changed_place(repository.changes(base, pull.head))
    _check_place(place, board)
    then, at_head, at_base = (
        repository.resolve(f"{at}:{place.path}") for at in (base, pull.head, BASE)
    )
    if at_base is None:
        _check_case(repository, place)
    owner = former_owner(place) if at_base is None else _owner(repository, place)
    is_new = at_base is None and owner is None
    if pull.account not in (owner, *board.maintainers) and not is_new:
        raise RefusedError(
            "this folder is or was on the board, and belongs to another account",
            where=place.path,
            expected="the account that its submission.toml names, or a maintainer of the board",
            fix="choose another folder, or open the pull request from that account",
        )
    if then != at_base:
        raise RefusedError(
            "has changed on the board since this branch began",
            where=place.path,
            expected="the scored files to be the merged ones",
            fix="merge the board's branch into yours",
        )
    return Touched(place, at_head or "")


Owner = Callable[[Place], int | None]


def _merge_base(repository: Repository, pull: PullRequest) -> str:
    """Return the one merge base of a pull request."""
    bases = repository.merge_bases(BASE, pull.head)
    if len(bases) != 1:
        raise RefusedError(
            f"went apart from the branch at {len(bases)} commits"
            if bases
            else "the commit has no history in common with the branch",
            where=pull.base,
            expected="one, so that it is certain what a merge would change",
            fix=f"merge {pull.base} into your branch, or start it anew from there",
        )
    return bases[0]


def _changed_place(paths: Sequence[bytes]) -> Place:
    """Return the one folder in which all changes lie."""
    deep = [b"/".join(path.split(b"/")[:4]) for path in paths if path.count(b"/") >= 3]
    folders = list(dict.fromkeys(path for path in deep if path.startswith(b"submissions/")))
    above = {b"/".join(one.split(b"/")[:n]) for one in folders for n in (1, 2, 3)}
    inner = {b"/".join(one[:n]) for one in (p.split(b"/") for p in paths) for n in range(len(one))}
    others = [
        path
        for path in paths
        if path not in above | inner and not path.startswith(tuple(folders) or b"/")
    ]
    outside = [path for path in others if not path.startswith(b"submissions/")]
    if outside:
        raise RefusedError(
            f"changes other files than those of a submission: {_named(outside)}",
            expected="one folder below submissions/, and nothing else",
            fix="put the other changes into a pull request of their own",
        )
    if len(folders) > 1:
        raise RefusedError(
            f"changes more than one folder: {_named(folders)}",
            expected="one submission a pull request; a renamed folder counts as two",
            fix="make a pull request for each",
        )
    if not folders or others or all(path == folders[0] for path in paths if path not in above):
        raise RefusedError(
            "not the folder of a submission",
            where=_shown((others or folders)[0]),
            expected="submissions/<benchmark>/<track>/<folder>/...",
            fix="`airzoo-bench submit` makes the right folder",
        )
    return Place(*_checked_path(folders[0]).split("/")[1:])


def _named(paths: Sequence[bytes]) -> str:
    return first_of([_shown(path) for path in paths])


def _check_place(place: Place, board: Board) -> None:
    known = [benchmark.name for benchmark in board.benchmarks]
    for what, name, names in (
        ("benchmark", place.benchmark, known),
        ("track", place.track, list(TRACKS.names())),
    ):
        if name not in names:
            raise RefusedError(
                f"this board has no {what} {name!r}{nearest(name, names)}",
                where=place.path,
                expected=f"one of {', '.join(names)}",
                fix="move the folder",
            )


def _check_case(repository: Repository, place: Place) -> None:
    for path in repository.names(BASE, f"submissions/{place.benchmark}/{place.track}"):
        name = path.rsplit(b"/", 1)[-1].decode("utf-8", "replace")
        if name.casefold() == place.folder.casefold():
            raise RefusedError(
                f"differs from the folder {name} of the board only in case",
                where=place.path,
                fix="choose another name",
            )


def _owner(repository: Repository, place: Place) -> int | None:
    """Return the account that the submission names which is on the board."""
    file = repository.resolve(f"{BASE}:{place.path}/{SUBMISSION_FILE}")
    try:
        account = tomllib.loads(repository.blob(file or "").decode()).get("account")
    except (ValueError, BoardError):
        return None
    return account if isinstance(account, int) else None


def submitted(repository: Repository, benchmarks: Sequence[str]) -> Iterator[Place | str]:
    """Yield the submissions on the board's branch, or a sentence for a folder that is none."""
    for benchmark in benchmarks:
        for track in TRACKS.names():
            for path in repository.names(BASE, f"submissions/{benchmark}/{track}"):
                place = Place(benchmark, track, path.rsplit(b"/", 1)[-1].decode("utf-8", "replace"))
                if place.fault:
                    yield f"{_shown(path)}: no submission, and skipped: {place.fault}"
                elif repository.resolve(f"{BASE}:{place.path}/{SUBMISSION_FILE}"):
                    yield place
                else:
                    yield f"{place.path}: no submission, and skipped: it has no {SUBMISSION_FILE}"


def read_files(
    repository: Repository, commit: str, place: Place, board: Board, into: Path
) -> list[UserError]:
    """Write the files of a submission into a fresh folder, if names, kinds and sizes are right."""
    entries = repository.entries(commit, place.path)
    faults = [fault for entry in entries if (fault := _fault(entry))] or _alike(entries)
    if faults:
        return [*faults[:_MOST_FAULTS]]
    total = 0
    most = board.limits.committed_bytes
    for entry, size in zip(entries, repository.sizes([e.object_id for e in entries]), strict=True):
        total += size
        is_stated = entry.path.decode() == f"{place.path}/{SUBMISSION_FILE}"
        if total > most or (is_stated and size > _MOST_TOML_BYTES):
            return [RefusedError(
                f"has {size:,} bytes" if is_stated else f"the files have more than {most:,} bytes",
                where=_shown(entry.path),
                expected=f"at most {_MOST_TOML_BYTES:,} bytes of metadata, {most:,} in all",
                fix="give the predictions by URL: `airzoo-bench submit --url`",
            )]  # fmt: skip
    for entry in entries:
        path = into / _checked_path(entry.path)
        repository.write_blob(entry.object_id, path)
        with path.open("rb") as stream:
            if stream.read(len(_LFS)) == _LFS:
                return [RefusedError(
                    "is a pointer of Git LFS, not the file itself",
                    where=_shown(entry.path),
                    expected="the content, which this board reads from git alone",
                    fix="`git lfs untrack` it and commit it, or give the predictions by URL",
                )]  # fmt: skip
    return []


def _fault(entry: Entry) -> RefusedError | None:
    if entry.mode != "100644":
        kind, fix = _KINDS.get(entry.mode, (f"of mode {entry.mode}", None))
        where = _shown(entry.path)
        return RefusedError(f"is {kind}", where=where, expected="a plain file", fix=fix)
    try:
        _checked_path(entry.path)
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


def _checked_path(path: bytes) -> str:
    """Return a path as text, if a disk may have it."""
    try:
        text = path.decode("utf-8")
    except UnicodeDecodeError as error:
        raise RefusedError("the name is not UTF-8", where=_shown(path), fix=RENAME) from error
    parts = text.split("/")
    faults = [fault_of_file_name(part) for part in parts]
    if text != unicodedata.normalize("NFC", text):
        faults.insert(0, "the name is not in Unicode's normal form NFC")
    if len(parts) > DEPTH:
        faults.append(f"lies in more than {DEPTH} folders")
    for fault in filter(None, faults):
        raise RefusedError(fault, where=_shown(path), fix=RENAME)
    return text


def _shown(path: bytes) -> str:
    """Return a path for messages: on one line, without bytes that are no text."""
    text = path.decode("utf-8", "backslashreplace")
    shown = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
    return shown if len(shown) <= 200 else f"{shown[:200]}..."
