"""Git as a store of strangers' objects: bare repositories, no work tree, no filters, no hooks."""

from __future__ import annotations

import base64
import os
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from threading import Timer

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.checks import MOST_FILES

TOKEN_VARIABLE = "GIT_TOKEN"
"""The variable of the environment with a token for the remote; it never stands in arguments."""

_KEPT = ("PATH", "HOME", "SSL_CERT_FILE", "GIT_SSL_CAINFO", "HTTPS_PROXY", "https_proxy", "TMPDIR")
_SETTINGS = {
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_ATTR_NOSYSTEM": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_ALLOW_PROTOCOL": "https:ssh:file",
    "LC_ALL": "C",
}
_SETTINGS |= {f"GIT_{role}_NAME": "leaderboard" for role in ("AUTHOR", "COMMITTER")}
_SETTINGS |= {
    f"GIT_{role}_EMAIL": "leaderboard@users.noreply.github.com" for role in ("AUTHOR", "COMMITTER")
}
_SAFE = ("-c", "core.hooksPath=/dev/null", "-c", "transfer.fsckObjects=true")
_FETCH = ("fetch", "--quiet", "--no-tags", "--no-recurse-submodules", "--no-write-fetch-head")
_OBJECT_ID = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
_LISTING_BYTES = (MOST_FILES + 1) * 512  # of an entry's line; paths are some thousand bytes at most
_BATCH = 64
_TIMEOUT_S, _LISTING_S = 1800, 120
# Git's words where somebody else has pushed since, before or while this push was received.
_OVERTAKEN = (b"[rejected]", b"cannot lock ref", b"failed to update ref", b"incorrect old value")


class BoardError(SubmissionError):
    """The board, its data or its remote is not as it must be: no fault of a submission."""


class RefusedError(SubmissionError):
    """A pull request is not as it must be."""


class Repository:
    """An empty bare repository that only fetches, reads and pushes objects.

    The remote is the only address that is sent the token.
    """

    def __init__(self, folder: Path, remote: str) -> None:
        self.folder, self.remote = folder, remote
        folder.parent.mkdir(parents=True, exist_ok=True)
        self.run("init", "--quiet", "--bare", "--template=")
        self.run("config", "remote.origin.url", remote)

    def run(self, *arguments: str, stdin: bytes = b"", index: Path | None = None) -> bytes:
        """Run git and return its output."""
        done = self._call(*arguments, stdin=stdin, index=index)
        _check(done, arguments[0])
        return done.stdout

    def fetch(self, refs: Mapping[str, str], *, blobs: bool, depth: int | None = None) -> None:
        """Fetch refs of the remote under names of our own."""
        options = [] if blobs else ["--filter=blob:none"]
        options += [] if depth is None else [f"--depth={depth}"]
        pairs = [f"+{theirs}:{ours}" for theirs, ours in refs.items()]
        done = self._call(*_FETCH, *options, "origin", *pairs)
        said = done.stderr.decode("utf-8", "replace").strip()
        if "fsck" in said or "error in object" in said:
            what = f"git refuses its objects: {said.splitlines()[0][:200]}"
            raise RefusedError(what, fix="make the commit anew, by git itself")
        if "find remote ref" in said:
            expected = f"{' and '.join(refs)} there"
            raise BoardError(said.removeprefix("fatal: "), where=self.remote, expected=expected)
        _check(done, "fetch")

    def resolve(self, name: str) -> str | None:
        """Return the id of a commit or, for ``commit:path``, of a tree or file; None without one.

        The name is made of our own words; a path in it has been checked.
        """
        done = self._call("rev-parse", "--verify", "--quiet", "--end-of-options", name)
        found = done.stdout.decode("ascii", "replace").strip()
        return found if done.returncode == 0 and _OBJECT_ID.fullmatch(found) else None

    def contains(self, ref: str, commit: str) -> bool:
        """Whether a commit is that of a ref of ours, or one before it."""
        return self._call("merge-base", "--is-ancestor", commit, ref).returncode == 0

    def merge_bases(self, one: str, other: str) -> list[str]:
        """Return the merge bases of two commits: more than one after merges."""
        done = self._call("merge-base", "--all", one, other)
        return done.stdout.decode("ascii").split() if done.returncode == 0 else []

    def changes(self, old: str, new: str) -> list[str]:
        """Return all paths that differ between two commits, of files and of folders."""
        listed = self._listed("diff-tree", "-r", "-t", "-z", "--no-renames", old, new)
        return [os.fsdecode(path) for path in listed.split(b"\0")[1::2]]

    def entries(self, commit: str, folder: str) -> Iterator[tuple[str, int, str]]:
        """Yield path, mode and id of all files below a folder of a commit, and of empty folders."""
        text = self._listed("ls-tree", "-r", "-t", "-z", "--full-tree", commit, "--", f"{folder}/")
        found = []
        for line in text.split(b"\0")[:-1]:
            head, path = line.split(b"\t", 1)
            mode, _, object_id = head.decode("ascii").split(" ")
            if path.startswith(f"{folder}/".encode()):
                found.append((os.fsdecode(path), int(mode, 8), object_id))
        parents = {path.rpartition("/")[0] for path, *_ in found}
        yield from (one for one in found if one[0] not in parents)

    def names(self, commit: str, folder: str) -> list[str]:
        """Return the names directly in a folder of a commit."""
        options = ("ls-tree", "-z", "--full-tree", "--name-only")
        listed = self.run(*options, commit, "--", f"{folder}/").split(b"\0")[:-1]
        return [os.fsdecode(path).rpartition("/")[2] for path in listed]

    def sizes(self, object_ids: Sequence[str]) -> Iterator[int]:
        """Yield the size of each object; those of a batch are fetched together, not more."""
        for start in range(0, len(object_ids), _BATCH):
            lines = "".join(f"{one}\n" for one in object_ids[start : start + _BATCH]).encode()
            # Git itself fetches one by one, when asked, what this cannot bring.
            noop = ("-c", "fetch.negotiationAlgorithm=noop")
            self._call(*noop, *_FETCH, "--filter=blob:none", "--stdin", "origin", stdin=lines)
            found = self.run("cat-file", "--batch-check=%(objectsize)", stdin=lines)
            yield from map(int, found.split())

    def blob(self, object_id: str) -> bytes:
        """Return the content of a file whose size has been checked."""
        return self.run("cat-file", "blob", object_id)

    def commit(self, parent: str | None, files: Mapping[str, bytes], message: str) -> str:
        """Make a commit that adds or replaces files; there is no work tree."""
        index = self.folder / "index.new"
        index.unlink(missing_ok=True)
        if parent is not None:
            self.run("read-tree", parent, index=index)
        lines = b""
        for path, text in files.items():
            object_id = self.run("hash-object", "-w", "--stdin", stdin=text).strip()
            lines += b"100644 " + object_id + f"\t{path}\0".encode()
        self.run("update-index", "-z", "--index-info", stdin=lines, index=index)
        tree = self.run("write-tree", "--missing-ok", index=index).decode("ascii").strip()
        parents = [] if parent is None else ["-p", parent]
        made = self.run("commit-tree", *parents, tree, stdin=message.encode())
        return made.decode("ascii").strip()

    def push(self, commit: str, ref: str) -> bool:
        """Push a commit; False where the remote has moved on meanwhile."""
        done = self._call("push", "--quiet", "--porcelain", "origin", f"{commit}:{ref}")
        if done.returncode and any(said in done.stdout for said in _OVERTAKEN):
            return False
        done.stderr += done.stdout
        _check(done, "push")
        return True

    def _call(
        self, *arguments: str, stdin: bytes = b"", index: Path | None = None
    ) -> subprocess.CompletedProcess[bytes]:
        """Run a command that may fail."""
        environment = self._environment()
        if index is not None:
            environment["GIT_INDEX_FILE"] = str(index)
        line = ["git", *_SAFE, f"--git-dir={self.folder}", *arguments]
        try:
            return subprocess.run(
                line, input=stdin, env=environment, capture_output=True, timeout=_TIMEOUT_S,
                check=False,
            )  # fmt: skip
        except FileNotFoundError as error:
            raise BoardError("git is not installed", fix="install git 2.36 or later") from error
        except subprocess.TimeoutExpired as error:
            what = f"git {arguments[0]} took longer than {_TIMEOUT_S} s"
            raise BoardError(what, where=self.remote) from error

    def _listed(self, *arguments: str) -> bytes:
        """Return a listing of a stranger's trees, bounded in bytes and time."""
        line = ["git", *_SAFE, f"--git-dir={self.folder}", *arguments]
        with subprocess.Popen(
            line, env=self._environment(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            # Trees of empty trees list nothing, for as long as one waits.
            watchdog = Timer(_LISTING_S, process.kill)
            watchdog.start()
            text = process.stdout.read(_LISTING_BYTES) if process.stdout else b""
            if len(text) == _LISTING_BYTES:
                process.kill()
            process.wait()
            watchdog.cancel()
        if len(text) == _LISTING_BYTES or text.count(b"\0") > 2 * MOST_FILES:
            what = f"more than {MOST_FILES:,} files and folders"
            raise RefusedError(what, fix="put the predictions into one archive, or give their URL")
        if process.returncode:
            raise RefusedError("git cannot read the trees of this commit", fix="make it anew")
        return text

    def _environment(self) -> dict[str, str]:
        kept = {name: os.environ[name] for name in _KEPT if name in os.environ} | _SETTINGS
        token = os.environ.get(TOKEN_VARIABLE)
        if not token or not self.remote.startswith("https://"):
            return kept
        basic = base64.b64encode(f"x-access-token:{token}".encode()).decode("ascii")
        return kept | {
            "GIT_CONFIG_COUNT": "1",
            "GIT_CONFIG_KEY_0": f"http.{self.remote}.extraHeader",
            "GIT_CONFIG_VALUE_0": f"Authorization: Basic {basic}",
        }


def _check(done: subprocess.CompletedProcess[bytes], name: str) -> None:
    """Raise git's words on a command that failed."""
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip()[-500:]
        raise BoardError(f"git {name} failed: {said or f'exit code {done.returncode}'}")
