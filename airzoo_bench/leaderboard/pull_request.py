"""Pull requests: they may change one submission, in one folder, which is their author's own."""

from __future__ import annotations

import json
import re
import stat
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from airzoo_bench.core.errors import SubmissionError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.board import Board, Place, plain_name
from airzoo_bench.leaderboard.checks import check_listing, printable
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE

_HEAD, _BASE = "refs/heads/head", "refs/heads/base"
_BATCH = 64


class PullRequest(NamedTuple):
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
        [head] = re.findall("^(?:[0-9a-f]{40}|[0-9a-f]{64})$", pull["head"]["sha"])
        return PullRequest(
            int(pull["number"]), head, str(pull["base"]["ref"]), int(pull["user"]["id"])
        )
    except (ValueError, KeyError, TypeError) as error:
        what = f"not the event of a pull request: {error!r}"[:200]
        raise SubmissionError(what, where=path, expected="$GITHUB_EVENT_PATH") from error


def fetch_changed(
    repository: Repository,
    pull: PullRequest,
    board: Board,
    former_owner: Callable[[Place], int | None],
) -> tuple[Place, bool] | None:
    """Fetch a pull request without the files' content, and return which submission it changes.

    Also return whether it leaves it there; None where it changes none. `former_owner` returns the
    account of a folder that is no longer on the board.
    """
    refs = {f"refs/pull/{pull.number}/head": _HEAD, f"refs/heads/{pull.base}": _BASE}
    repository.fetch(refs, "--filter=blob:none")
    if repository.call("merge-base", "--is-ancestor", pull.head, _HEAD).returncode:
        what = f"the commit {pull.head[:12]} is no longer part of pull request {pull.number}"
        raise BoardError(what, fix="nothing: the newer commit is scored by its own run")
    bases = repository.call("merge-base", "--all", _BASE, pull.head).stdout.decode().split()
    if len(bases) != 1:
        fix = f"start your branch anew from {pull.base}"
        raise RefusedError(f"has {len(bases)} merge bases with {pull.base}, not one", fix=fix)
    [base] = bases
    if len({repository.resolve(f"{commit}:submissions") for commit in (pull.head, base)}) == 1:
        return None  # its other changes are none of a board's business
    place = _find_place(repository.changes(base, pull.head, 4), board)
    then, at_head, at_base = (
        repository.resolve(f"{at}:{place.path}") for at in (base, pull.head, _BASE)
    )
    owner = former_owner(place) if at_base is None else _find_owner(repository, place)
    is_new = at_base is None and owner is None
    if pull.account not in (owner, *board.maintainers) and not is_new:
        what = "this folder is or was on the board, and belongs to another account"
        raise RefusedError(what, where=place.path, fix="choose another folder")
    if then != at_base:
        what = "has changed on the board since this branch began"
        raise RefusedError(what, where=place.path, fix=f"merge {pull.base} into your branch")
    return place, at_head is not None


def _find_place(changes: Sequence[tuple[str, bool]], board: Board) -> Place:
    """Return the one folder that holds all changes."""
    if outside := [path for path, _ in changes if path.split("/")[0] != "submissions"]:
        what = (
            f"changes other files than those of a submission: {first_of(map(printable, outside))}"
        )
        raise RefusedError(what, fix="put the other changes into a pull request of their own")
    for path, is_folder in changes:
        if not is_folder or path.count("/") < 3 or not all(map(plain_name, path.split("/"))):
            expected = "submissions/<benchmark>/<track>/<folder>/..., with plain names"
            what, fix = (
                "not the folder of a submission",
                "`airzoo-bench submit` makes the right one",
            )
            raise RefusedError(what, where=printable(path), expected=expected, fix=fix)
    if len(changes) > 1:
        what = f"changes more than one folder: {first_of(path for path, _ in changes)}"
        raise RefusedError(what, fix="make a pull request for each; a rename counts as two")
    place = Place(*changes[0][0].split("/")[1:])
    benchmarks = [one.name for one in board.benchmarks]
    for name, names in ((place.benchmark, benchmarks), (place.track, [*TRACKS.names()])):
        if name not in names:
            what = f"this board has no {name!r}{nearest(name, names)}"
            raise RefusedError(what, where=place.path, fix="move the folder")
    return place


def _find_owner(repository: Repository, place: Place) -> int | None:
    """Return the account that the submission names which is on the board."""
    file = repository.resolve(f"{_BASE}:{place.path}/{SUBMISSION_FILE}")
    try:
        account = tomllib.loads(repository.run("cat-file", "blob", file or "").decode())["account"]
    except (ValueError, KeyError, BoardError):
        return None
    return account if isinstance(account, int) else None


def write_files(
    repository: Repository, commit: str, place: Place, board: Board, into: Path
) -> None:
    """Write the files of a submission into a fresh folder, if names, kinds and sizes are right."""
    entries, total = repository.entries(commit, place.path), 0
    check_listing([(path, mode, 0) for path, mode, _ in entries], place.path, board.limits)
    files = [(path, of) for path, mode, of in entries if stat.S_ISREG(mode)]
    for start in range(0, len(files), _BATCH):  # the rest is not fetched where this is too much
        total += sum(repository.fetch_sizes([of for _, of in files[start : start + _BATCH]]))
        check_listing([("all", stat.S_IFREG, total)], place.path, board.limits)
    for path, of in files:
        target = into / place.path / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(repository.run("cat-file", "blob", of))
