"""Git: pull requests, which may change one submission of their author's own, and the data branch.

Git is a store of strangers' objects: no work tree of theirs, no filters, no hooks. The branch with
the board's data (runs, tries, answers of sealed truths) is written by CI only.
"""

from __future__ import annotations

import base64
import csv
import datetime
import json
import os
import re
import shutil
import stat
import subprocess
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from airzoo_bench.core.errors import SubmissionError, counted, first_of, printable, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.leaderboard.answers import FAULT_FILE, TIME, Answer, run_folders
from airzoo_bench.leaderboard.board import Board, Limits, Place
from airzoo_bench.leaderboard.checks import MOST_FILES, check_listing
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, read_submission

TOKEN_VARIABLE = "GIT_TOKEN"  # of the environment: a token for the remote, never an argument

_SETTINGS = {
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_ATTR_NOSYSTEM": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_ALLOW_PROTOCOL": "https:ssh:file",
    "LC_ALL": "C",
}
_WRITER = {"NAME": "leaderboard", "EMAIL": "leaderboard@users.noreply.github.com"}
_SETTINGS |= {f"GIT_{role}_{k}": v for role in ("AUTHOR", "COMMITTER") for k, v in _WRITER.items()}
_SAFE = ("-c", "core.hooksPath=/dev/null", "-c", "transfer.fsckObjects=true")
_FETCH = ("fetch", "--quiet", "--no-tags", "--no-recurse-submodules", "--no-write-fetch-head")
_LISTING_BYTES = (MOST_FILES + 1) * 512  # of an entry's line; paths are some thousand bytes at most
_EMPTY_TREE = "4b825dc642cb6eb9a060e54bf8d69288fbee4904"
_HEAD, _BASE = "refs/heads/head", "refs/heads/base"
_BATCH = 64
_DATA, _COPY = "refs/heads/leaderboard-data", "refs/remotes/origin/data"
_PUSHES = 8

FindOwner = Callable[[Place], int | None]
_TRIES_FILE = "tries.csv"


class BoardError(SubmissionError):
    """The board, its data or its remote is not as it must be: no fault of a submission."""


class RefusedError(SubmissionError):
    """A pull request is not as it must be."""


class Repository:
    """A new repository of our own; only its remote gets the token."""

    def __init__(self, folder: Path, remote: str) -> None:
        self.folder = folder
        self.remote = str(Path(remote).resolve()) if Path(remote).exists() else remote
        folder.mkdir(parents=True, exist_ok=True)
        self.run("init", "--quiet", "--template=")
        self.run("config", "remote.origin.url", self.remote)

    def run(self, *arguments: str, stdin: bytes = b"") -> bytes:
        """Run git and return its output."""
        done = self.call(*arguments, stdin=stdin)
        if done.returncode:
            said = (done.stderr + done.stdout).decode("utf-8", "replace").strip()[-500:]
            raise BoardError(f"git {arguments[0]} failed: {said or done.returncode}")
        return done.stdout

    def call(self, *arguments: str, stdin: bytes = b"") -> subprocess.CompletedProcess[bytes]:
        """Run a command that may fail."""
        line, own = ["git", *_SAFE, "-C", str(self.folder), *arguments], self._environment()
        return subprocess.run(line, input=stdin, env=own, capture_output=True, check=False)

    def fetch(self, refs: Mapping[str, str], *options: str) -> None:
        """Fetch refs of the remote under names of our own."""
        pairs = [f"+{theirs}:{ours}" for theirs, ours in refs.items()]
        done = self.call(*_FETCH, *options, "origin", *pairs)
        said = done.stderr.decode("utf-8", "replace").strip()
        if "fsck" in said or "error in object" in said:
            what = f"git refuses its objects: {said.splitlines()[0][:200]}"
            raise RefusedError(what, fix="make the commit anew, by git itself")
        if done.returncode:
            raise BoardError(f"git fetch failed: {said[-500:]}", where=self.remote)

    def resolve(self, name: str) -> str | None:
        """Return the id of a commit or, for ``commit:path``, of a tree or file, if there is one."""
        done = self.call("rev-parse", "--verify", "--quiet", "--end-of-options", name)
        return None if done.returncode else done.stdout.decode("ascii").strip()

    def changes(self, old: str, new: str, folder: str) -> dict[str, bool]:
        """Return which names in a folder differ between commits, and whether each is a folder."""
        trees = [self.resolve(f"{commit}:{folder}") or _EMPTY_TREE for commit in (old, new)]
        listed = self.read_listing("diff-tree", "-z", "--no-renames", *trees).split(b"\0")
        return {
            os.fsdecode(name): {*about[1:].split(b" ")[:2]} <= {b"040000", b"000000"}
            for about, name in zip(listed[::2], listed[1::2], strict=False)
        }

    def read_listing(self, *arguments: str) -> bytes:
        """Return a listing of a stranger's trees, bounded in bytes."""
        line = ["git", *_SAFE, "-C", str(self.folder), *arguments]
        with subprocess.Popen(
            line, env=self._environment(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            text = process.stdout.read(_LISTING_BYTES) if process.stdout else b""
            process.kill() if len(text) == _LISTING_BYTES else process.wait()
        if len(text) == _LISTING_BYTES or text.count(b"\0") > 2 * MOST_FILES:
            what = f"more than {MOST_FILES:,} files and folders"
            raise RefusedError(what, fix="put the predictions into one archive, or give their URL")
        if process.returncode:
            raise RefusedError("git cannot read the trees of this commit", fix="make it anew")
        return text

    def _environment(self) -> dict[str, str]:
        kept = {key: text for key, text in os.environ.items() if not key.startswith("GIT_")}
        token = os.environ.get(TOKEN_VARIABLE)
        if token and self.remote.startswith("https://"):
            basic = base64.b64encode(f"x-access-token:{token}".encode()).decode("ascii")
            kept |= {"GIT_CONFIG_COUNT": "1", "GIT_CONFIG_KEY_0": f"http.{self.remote}.extraHeader"}
            kept["GIT_CONFIG_VALUE_0"] = f"Authorization: Basic {basic}"
        return kept | _SETTINGS


# --- pull requests ---


class PullRequest(NamedTuple):
    """The parts of a pull request that count."""

    number: int
    head: str  # the commit to score, and no other
    base: str  # the branch that it is to be merged into
    account: int  # of its author: the number stays when a name changes


def read_event(path: Path) -> PullRequest:
    """Read the event of a pull request, as GitHub writes it."""
    what, fix = "not the event of a pull request", "give $GITHUB_EVENT_PATH"
    with readable(path, what, kind=BoardError, fix=fix):
        pull = json.loads(read_text(path, BoardError, "event"))["pull_request"]
        [head] = re.findall("^(?:[0-9a-f]{40}|[0-9a-f]{64})$", pull["head"]["sha"])
        base, account = str(pull["base"]["ref"]), int(pull["user"]["id"])
        return PullRequest(int(pull["number"]), head, base, account)


def fetch_changed(
    repository: Repository, pull: PullRequest, board: Board, find_owner: FindOwner
) -> tuple[Place, bool] | None:
    """Fetch a pull request without the files' content, and return which submission it changes.

    Also return whether it leaves it there; None where it changes none. `find_owner` knows the
    accounts of submissions that were withdrawn.
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
    place = _find_place(repository, base, pull.head)
    trees = [repository.resolve(f"{at}:{place.path}") for at in (base, pull.head, _BASE)]
    then, at_head, at_base = trees
    owner = find_owner(place) if at_base is None else _find_owner(repository, place)
    is_new = at_base is None and owner is None
    if pull.account not in (owner, *board.maintainers) and not is_new:
        what = "this folder is or was on the board, and belongs to another account"
        raise RefusedError(what, where=place.path, fix="choose another folder")
    if then != at_base:
        what = "has changed on the board since this branch began"
        raise RefusedError(what, where=place.path, fix=f"merge {pull.base} into your branch")
    return place, at_head is not None


def _find_place(repository: Repository, base: str, head: str) -> Place:
    """Return the one folder that holds all changes, which is found level by level."""
    fix, parts = "make a pull request for each submission; a rename counts as two", list[str]()
    while len(parts) < 4:
        changed = repository.changes(base, head, "/".join(parts))
        names = sorted(changed, key=lambda name: name == "submissions")
        is_other = not parts and names != ["submissions"]
        if is_other or len(names) != 1:
            what = "other files than those of a submission" if is_other else "more than one folder"
            raise RefusedError(f"changes {what}: {first_of(map(printable, names))}", fix=fix)
        parts += names
        if not changed[names[0]] or not Place("a", "a", names[0]).is_plain:
            expected = "submissions/<benchmark>/<track>/<folder>/..., with plain names"
            what, where = "not the folder of a submission", printable("/".join(parts))
            raise RefusedError(what, where=where, expected=expected)
    return Place(*parts[1:])


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
    options = ("-r", "-t", "-z", "--full-tree")
    text = repository.read_listing("ls-tree", *options, f"{commit}:{place.path}")
    entries = []
    for head, name in (line.split(b"\t", 1) for line in text.split(b"\0")[:-1]):
        mode, _, object_id = head.decode("ascii").split(" ")
        entries.append((os.fsdecode(name), int(mode, 8), object_id))
    check_listing(((name, mode, 0) for name, mode, _ in entries), place.path, board.limits)
    files = [(name, object_id) for name, mode, object_id in entries if stat.S_ISREG(mode)]
    (into / place.path).mkdir(parents=True)
    total = 0
    for start in range(0, len(files), _BATCH):  # the rest is not fetched where this is too much
        lines = "".join(f"{of}\n" for _, of in files[start : start + _BATCH]).encode()
        # Git itself fetches one by one, when asked, what this cannot bring.
        noop = ("-c", "fetch.negotiationAlgorithm=noop")
        repository.call(*noop, *_FETCH, "--filter=blob:none", "--stdin", "origin", stdin=lines)
        sizes = repository.run("cat-file", "--batch-check=%(objectsize)", stdin=lines)
        total += sum(map(int, sizes.split()))
        check_listing([("all", stat.S_IFREG, total)], place.path, board.limits)
    for path, of in files:
        target = into / place.path / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(repository.run("cat-file", "blob", of))


# --- the branch with the board's data ---


class Try(NamedTuple):
    """A line of the list of tries at sealed truths, by account and commit."""

    account: str
    benchmark: str
    head: str
    outcome: str  # started, scored, or failed by no fault of the submission: it comes back
    time: str


def check_tries(tries: Sequence[Try], new: Try, limits: Limits) -> None:
    """Refuse one more try than an account has on a sealed benchmark; a commit counts once."""
    last = {one.head: one for one in tries if one[:2] == new[:2] and one.head != new.head}
    since = datetime.datetime.fromisoformat(new.time) - datetime.timedelta(days=limits.days)
    counting = [t for t in last.values() if t.outcome != "failed" and t.time > f"{since:{TIME}}"]
    if len(counting) >= limits.tries:
        had, days = counted(len(counting), "try", "tries"), counted(limits.days, "day")
        what = f"this account has had {had} on {new.benchmark} within {days}"
        raise RefusedError(what, expected=f"at most {limits.tries}", fix="push again later")


class DataBranch:
    """A clone of the branch, with a work tree: nobody but CI writes to it."""

    def __init__(self, folder: Path, remote: str) -> None:
        self.folder, self._repository = folder, Repository(folder, remote)
        self._update()

    def answer_path(self, tree: str) -> Path:
        """Return where the answer to a sealed submission is kept until it is merged."""
        return self.folder / f"answers/{tree}.json"

    def find_owner(self, place: Place) -> int | None:
        """Return the account of a place's last run; 0 if it names none, None without a run."""
        files = (run / SUBMISSION_FILE for run in run_folders(self.folder / place.runs)[:1])
        return next((read_submission(file, public=True).account or 0 for file in files), None)

    def copy_runs(self, places: Iterable[Place], out: Path) -> None:
        """Copy the runs of some submissions into a folder, below ``runs/``."""
        for place in places:
            if (self.folder / place.runs).is_dir():
                shutil.copytree(self.folder / place.runs, out / place.runs, dirs_exist_ok=True)

    def tries(self) -> list[Try]:
        """Return the list of tries."""
        path = self.folder / _TRIES_FILE
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        return [Try(*row) for row in list(csv.reader(text.splitlines()))[1:]]

    def add_try(self, line: Try, limits: Limits, answer: Answer | None = None) -> None:
        """Add a line to the list of tries, refused where it starts one too many, and an answer."""

        def change() -> None:
            tries = self.tries()
            if line.outcome == "started":
                check_tries(tries, line, limits)
            with (self.folder / _TRIES_FILE).open("w", encoding="utf-8", newline="") as stream:
                csv.writer(stream, lineterminator="\n").writerows([Try._fields, *tries, line])
            if answer is not None:
                path = self.answer_path(answer.tree)
                path.parent.mkdir(exist_ok=True)
                path.write_text(answer.model_dump_json(), encoding="utf-8")

        self._write(change, f"{line.outcome}: {line.benchmark}")

    def add_runs(self, root: Path) -> None:
        """Add the runs below a folder, in place of runs of the same number."""
        fault, target = shutil.ignore_patterns(FAULT_FILE), self.folder / "runs"
        self._write(
            lambda: shutil.copytree(root / "runs", target, dirs_exist_ok=True, ignore=fault), "runs"
        )

    def _write(self, change: Callable[[], object], message: str) -> None:
        """Commit a change and push it; where somebody else was faster, again on top of that."""
        git = self._repository
        for number in range(_PUSHES):
            change()
            git.run("add", "--all", "--force")
            if not git.run("status", "--porcelain"):
                return
            git.run("commit", "--quiet", "-m", message)
            done = git.call("push", "--quiet", "--porcelain", "origin", f"HEAD:{_DATA}")
            if not done.returncode:
                return
            time.sleep(0.1 * number)
            self._update()
        said = done.stderr.decode(errors="replace")[-500:]
        raise BoardError(f"git push failed: {said}", where=git.remote, fix="run the job again")

    def _update(self) -> None:
        """Bring the work tree to the branch, which may not be there yet."""
        git = self._repository
        if git.run("ls-remote", "origin", _DATA).strip():
            git.fetch({_DATA: _COPY}, "--depth=1")
            git.run("reset", "--quiet", "--hard", _COPY)
            git.run("clean", "--quiet", "-dffx")
