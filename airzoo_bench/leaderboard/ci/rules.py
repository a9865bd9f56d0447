"""What a pull request may change: one submission, in one folder, which is its author's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import UserError, first_of
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.board import Board, Limits
from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import BoardError, Change, Entry, RefusedError, Repository
from airzoo_bench.leaderboard.ci.ledger import Line, owner
from airzoo_bench.leaderboard.ci.paths import check_entries, checked_path, shown_path
from airzoo_bench.leaderboard.known import Place
from airzoo_bench.leaderboard.predictions_given import MOST_FILES
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE

__all__ = [
    "BASE",
    "HEAD",
    "Touched",
    "fetch_pull_request",
    "read_files",
    "submitted",
    "touched",
]

HEAD, BASE = "refs/heads/head", "refs/heads/base"

_ROOT = b"submissions/"
_MOST_NAMED = 20
_MOST_TOML_BYTES = 100_000
_LFS = b"version https://git-lfs.github.com/spec/"


@dataclass(frozen=True)
class Touched:
    """The one submission that a pull request changes.

    Attributes
    ----------
    tree : str
        Git's id of its folder at the head; empty where the pull request removes it.
    base : str
        The commit from which the pull request went apart.
    """

    place: Place
    tree: str
    base: str


def submitted(
    repository: Repository, benchmark: str, note: Callable[[str], None]
) -> Iterator[Place]:
    """Yield the submissions to a benchmark that stand on the board's branch."""
    for track in _plain(repository.folders(BASE, f"submissions/{benchmark}"), note):
        for folder in _plain(repository.folders(BASE, track), note):
            if repository.resolve(f"{BASE}:{folder}/{SUBMISSION_FILE}"):
                yield Place(*folder.split("/")[1:])
            else:
                note(f"{folder}: no submission, and skipped: it has no {SUBMISSION_FILE}")


def _plain(paths: Iterable[bytes], note: Callable[[str], None]) -> Iterator[str]:
    for path in paths:
        try:
            yield checked_path(path)
        except RefusedError as fault:
            note(f"{shown_path(path)}: no submission, and skipped: {fault.what}")


def fetch_pull_request(repository: Repository, pull: PullRequest) -> None:
    """Fetch head and base, without the files' content."""
    refs = {pull.ref: HEAD, f"refs/heads/{pull.base}": BASE}
    repository.fetch(refs, blobs=False)
    if not repository.contains(HEAD, pull.head):
        raise BoardError(
            f"the commit {pull.head[:12]} is no longer part of pull request {pull.number}",
            fix="nothing: the newer commit is scored by its own run",
        )


def touched(
    repository: Repository, pull: PullRequest, board: Board, ledger: Sequence[Line]
) -> Touched | None:
    """Return the submission that a pull request changes; None where it changes none."""
    base = _merge_base(repository, pull)
    now, before = (repository.resolve(f"{commit}:submissions") for commit in (pull.head, base))
    if now == before:  # whatever else it changes is none of a board's business
        return None
    place = _place_of(repository.changes(base, pull.head, _MOST_NAMED))
    _check_place(place, board)
    tree = repository.resolve(f"{pull.head}:{place.path}") or ""
    _check_owner(repository, place, pull, board, ledger)
    _check_base(repository, place, base)
    return Touched(place, tree, base)


def _merge_base(repository: Repository, pull: PullRequest) -> str:
    """Return the one commit from which a pull request went apart."""
    bases = repository.merge_bases(BASE, pull.head)
    if not bases:
        raise RefusedError(
            "the commit has no history in common with the branch",
            where=pull.base,
            fix=f"start your branch from {pull.base}",
        )
    if len(bases) > 1:
        raise RefusedError(
            f"went apart from the branch at {len(bases)} commits",
            where=pull.base,
            expected="one, so that it is certain what a merge would change",
            fix=f"merge {pull.base} into your branch, or start it anew from there",
        )
    return bases[0]


def _place_of(changes: Sequence[Change]) -> Place:
    """Return the one folder in which all changes lie."""
    others = [change for change in changes if not change.path.startswith(_ROOT)]
    if others:
        raise RefusedError(
            f"changes other files than those of a submission: {_named(others)}",
            expected="one folder below submissions/, and nothing else",
            fix="put the other changes into a pull request of their own",
        )
    if len(changes) > 1:
        raise RefusedError(
            f"changes more than one folder: {_named(changes)}",
            expected="one submission a pull request; a renamed folder counts as two",
            fix="make a pull request for each",
        )
    [change] = changes
    parts = checked_path(change.path).split("/")
    if len(parts) != 4 or not change.is_folder:
        raise RefusedError(
            "not the folder of a submission",
            where=shown_path(change.path),
            expected="submissions/<benchmark>/<track>/<folder>/...",
            fix="`airzoo-bench submission new` makes the right folder",
        )
    return Place(*parts[1:])


def _named(changes: Sequence[Change]) -> str:
    text = first_of([shown_path(change.path) for change in changes])
    return f"at least {text}" if len(changes) == _MOST_NAMED else text


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


def _check_owner(
    repository: Repository,
    place: Place,
    pull: PullRequest,
    board: Board,
    ledger: Sequence[Line],
) -> None:
    there = repository.resolve(f"{BASE}:{place.path}") is not None
    if not there:
        _check_case(repository, place)
    whose = owner(ledger, place)
    if pull.account in (whose, *board.maintainers) or (whose is None and not there):
        return
    raise RefusedError(
        f"this folder {'is' if there else 'was'} on the board already, and belongs to another "
        "account",
        where=place.path,
        expected="the account whose pull request brought it, or a maintainer of the board",
        fix="choose another folder, or open the pull request from that account",
    )


def _check_case(repository: Repository, place: Place) -> None:
    parent = f"submissions/{place.benchmark}/{place.track}"
    for path in repository.folders(BASE, parent):
        name = path.rsplit(b"/", 1)[-1].decode("utf-8", "replace")
        if name.casefold() == place.folder.casefold():
            raise RefusedError(
                f"differs from the folder {name} of the board only in case",
                where=place.path,
                fix="choose another name",
            )


def _check_base(repository: Repository, place: Place, base: str) -> None:
    """Refuse a folder that has changed since: what is merged would not be what is scored."""
    now, then = (repository.resolve(f"{at}:{place.path}") for at in (BASE, base))
    if now != then:
        raise RefusedError(
            "has changed on the board since this branch began",
            where=place.path,
            expected="what is scored to be what is merged",
            fix="merge the board's branch into yours",
        )


def read_files(
    repository: Repository, head: str, place: Place, limits: Limits, into: Path
) -> list[UserError]:
    """Write the files of a submission into a fresh folder, if names, kinds and sizes are right."""
    entries = repository.entries(head, place.path, MOST_FILES)
    faults: list[UserError] = [*check_entries(entries)]
    faults = faults or _faults_of_sizes(repository, entries, place, limits)
    if faults:
        return faults
    for entry in entries:
        path = into / checked_path(entry.path)
        path.parent.mkdir(parents=True, exist_ok=True)
        repository.write_blob(entry.object_id, path)
        faults += _faults_of_content(path, entry)
    return faults


def _faults_of_sizes(
    repository: Repository, entries: Sequence[Entry], place: Place, limits: Limits
) -> list[UserError]:
    """Ask for one size after the other, and for no more once it is too much."""
    total = 0
    for entry, size in zip(entries, repository.sizes([e.object_id for e in entries]), strict=True):
        total += size
        name = shown_path(entry.path)
        if name == f"{place.path}/{SUBMISSION_FILE}" and size > _MOST_TOML_BYTES:
            return [RefusedError(
                f"has {size:,} bytes",
                where=name,
                expected=f"at most {_MOST_TOML_BYTES:,} bytes of metadata",
                fix="predictions go into files of their own",
            )]  # fmt: skip
        if total > limits.committed_bytes:
            return [RefusedError(
                f"the files have more than {limits.committed_bytes:,} bytes",
                where=place.path,
                expected=f"at most {limits.committed_bytes:,} bytes in the repository",
                fix="give the predictions by URL: `airzoo-bench submission new --url`",
            )]  # fmt: skip
    return []


def _faults_of_content(path: Path, entry: Entry) -> list[RefusedError]:
    with path.open("rb") as stream:
        is_pointer = stream.read(len(_LFS)) == _LFS
    if not is_pointer:
        return []
    return [RefusedError(
        "is a pointer of Git LFS, not the file itself",
        where=shown_path(entry.path),
        expected="the content, which this board reads from git alone",
        fix="`git lfs untrack` it and commit it, or give the predictions by URL",
    )]  # fmt: skip
