"""Pull requests: they may change one submission, in one folder, which is their author's own."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.board import Board, Place, plain_name
from airzoo_bench.leaderboard.checks import check_listing
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE

HEAD, BASE = "refs/heads/head", "refs/heads/base"

_MOST_TOML_BYTES = 100_000
_FILE, _FOLDER = 0o100644, 0o040000


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


@dataclass(frozen=True)
class Touched:
    """The one submission that a pull request changes.

    `tree` is git's id of its folder at the head, empty where the pull request removes it.
    """

    place: Place
    tree: str


def read_event(path: Path) -> PullRequest:
    """Read the event of a pull request, as GitHub writes it."""
    try:
        pull = json.loads(read_text(path, SubmissionError, "event"))["pull_request"]
        head, base = str(pull["head"]["sha"]), str(pull["base"]["ref"])
        found = PullRequest(int(pull["number"]), head, base, int(pull["user"]["id"]))
        if set(head) - set("0123456789abcdef") or len(head) not in (40, 64):
            raise ValueError("head.sha is no commit")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        what = f"not the event of a pull request: {error!r}"[:200]
        raise SubmissionError(what, where=path, expected="$GITHUB_EVENT_PATH") from error
    return found


def fetch_pull_request(repository: Repository, pull: PullRequest) -> None:
    """Fetch head and base, without the files' content."""
    refs = {f"refs/pull/{pull.number}/head": HEAD, f"refs/heads/{pull.base}": BASE}
    repository.fetch(refs, blobs=False)
    if not repository.contains(HEAD, pull.head):
        what = f"the commit {pull.head[:12]} is no longer part of pull request {pull.number}"
        raise BoardError(what, fix="nothing: the newer commit is scored by its own run")


def find_touched(
    repository: Repository,
    pull: PullRequest,
    board: Board,
    former_owner: Callable[[Place], int | None],
) -> Touched | None:
    """Return the submission that a pull request changes; None where it changes none.

    `former_owner` returns the account of a folder that is no longer on the board.
    """
    bases = repository.merge_bases(BASE, pull.head)
    if len(bases) != 1:
        fix = f"start your branch anew from {pull.base}"
        what = f"has {len(bases)} merge bases with the branch, not one"
        raise RefusedError(what, where=pull.base, fix=fix)
    [base] = bases
    now, before = (repository.resolve(f"{commit}:submissions") for commit in (pull.head, base))
    if now == before:  # its other changes are none of a board's business
        return None
    place = _find_place(repository.changes(base, pull.head), board)
    then, at_head, at_base = (
        repository.resolve(f"{at}:{place.path}") for at in (base, pull.head, BASE)
    )
    if at_base is None:
        _check_case(repository, place)
    owner = former_owner(place) if at_base is None else _find_owner(repository, place)
    is_new = at_base is None and owner is None
    if pull.account not in (owner, *board.maintainers) and not is_new:
        what = "this folder is or was on the board, and belongs to another account"
        raise RefusedError(what, where=place.path, fix="choose another folder")
    if then != at_base:
        what = "has changed on the board since this branch began"
        raise RefusedError(what, where=place.path, fix=f"merge {pull.base} into your branch")
    return Touched(place, at_head or "")


def _find_place(paths: Sequence[str], board: Board) -> Place:
    """Return the one folder that holds all changes."""
    parts = [path.split("/") for path in paths]
    inner = {"/".join(one[:n]) for one in parts for n in range(1, len(one))}
    leaves = [path for path in paths if path not in inner]
    folders = list(dict.fromkeys("/".join(p.split("/")[:4]) for p in leaves if p.count("/") > 3))
    if outside := [path for path in leaves if not path.startswith("submissions/")]:
        what = (
            f"changes other files than those of a submission: {first_of(map(printable, outside))}"
        )
        raise RefusedError(what, fix="put the other changes into a pull request of their own")
    beside = [path for path in leaves if path.count("/") < 4]
    if beside or not all(plain_name(part) for one in folders for part in one.split("/")):
        raise RefusedError(
            "not the folder of a submission",
            where=printable((beside or folders)[0]),
            expected="submissions/<benchmark>/<track>/<folder>/..., with plain names",
            fix="`airzoo-bench submit` makes the right folder",
        )
    if len(folders) > 1:
        what = f"changes more than one folder: {first_of(folders)}"
        raise RefusedError(what, fix="make a pull request for each; a rename counts as two")
    place = Place(*folders[0].split("/")[1:])
    for kind, name, names in (
        ("benchmark", place.benchmark, [one.name for one in board.benchmarks]),
        ("track", place.track, list(TRACKS.names())),
    ):
        if name not in names:
            what = f"this board has no {kind} {name!r}{nearest(name, names)}"
            raise RefusedError(what, where=place.path, fix="move the folder")
    return place


def _check_case(repository: Repository, place: Place) -> None:
    for name in repository.names(BASE, f"submissions/{place.benchmark}/{place.track}"):
        if name.casefold() == place.folder.casefold():
            what = f"differs from the folder {printable(name)} of the board only in case"
            raise RefusedError(what, where=place.path, fix="choose another name")


def _find_owner(repository: Repository, place: Place) -> int | None:
    """Return the account that the submission names which is on the board."""
    file = repository.resolve(f"{BASE}:{place.path}/{SUBMISSION_FILE}")
    try:
        account = tomllib.loads(repository.blob(file or "").decode()).get("account")
    except (ValueError, BoardError):
        return None
    return account if isinstance(account, int) else None


def find_merged(
    repository: Repository, benchmarks: Sequence[str]
) -> tuple[dict[Place, str], list[str]]:
    """Return the submissions on the board's branch, with git's ids, and folders that are none."""
    found, others = {}, []
    for benchmark in benchmarks:
        for track in TRACKS.names():
            for name in repository.names(BASE, f"submissions/{benchmark}/{track}"):
                place = Place(benchmark, track, name)
                at = f"{BASE}:{place.path}"
                if place.is_plain and repository.resolve(f"{at}/{SUBMISSION_FILE}"):
                    found[place] = repository.resolve(at) or ""
                else:
                    others.append(f"{printable(place.path)}: no submission, and skipped")
    return found, others


def read_files(
    repository: Repository, commit: str, place: Place, board: Board, into: Path
) -> list[UserError]:
    """Write the files of a submission into a fresh folder, if names, kinds and sizes are right."""
    cut = len(place.path) + 1
    found = repository.entries(commit, place.path)
    entries = [(path[cut:], mode, object_id) for path, mode, object_id in found]
    if not entries:
        return [RefusedError("not the folder of a submission: it has no files", where=place.path)]
    faults = [*check_listing([(p, mode, 0) for p, mode, _ in entries], place.path, board.limits)]
    empty = [path for path, mode, _ in entries if mode == _FOLDER]
    if faults or empty:
        return faults or [RefusedError(f"an empty folder: {empty[0]}", where=place.path)]
    total = 0
    for (path, *_), size in zip(entries, repository.sizes([e[2] for e in entries]), strict=True):
        total += size
        if path == SUBMISSION_FILE and size > _MOST_TOML_BYTES:
            expected = f"at most {_MOST_TOML_BYTES:,} bytes of metadata"
            where = f"{place.path}/{path}"
            return [RefusedError(f"has {size:,} bytes", where=where, expected=expected)]
        # The rest is not fetched where this is too much.
        if faults := [*check_listing([("all", _FILE, total)], place.path, board.limits)]:
            return faults
    for path, _, object_id in entries:
        target = into / place.path / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(repository.blob(object_id))
    return []


def printable(path: str) -> str:
    """Return a path for messages: on one line, without bytes that are no text."""
    shown = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in path)
    return shown if len(shown) <= 200 else f"{shown[:200]}..."
