"""Git as a store of strangers' objects: bare repositories, no work tree, no filters, no hooks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.ci.git_process import BoardError, GitProcess, check

__all__ = ["BoardError", "Change", "Entry", "RefusedError", "Repository"]

T = TypeVar("T")

_OBJECT_ID = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
_ENTRY_BYTES = 512  # of an entry's line, on average; paths are at most some thousand bytes long
_BATCH = 64
# What git says where somebody else has pushed since, before or while this push was received.
_OVERTAKEN = (b"[rejected]", b"cannot lock ref", b"failed to update ref", b"incorrect old value")


class RefusedError(SubmissionError):
    """A pull request is not as it must be."""


@dataclass(frozen=True)
class Change:
    """A path that differs between two commits; a mode of zeros means that it is not there."""

    path: bytes
    old_mode: str
    mode: str


@dataclass(frozen=True)
class Entry:
    """A file of a commit."""

    path: bytes
    mode: str
    object_id: str


@dataclass(frozen=True)
class Repository:
    """A bare repository that only fetches, reads and pushes objects.

    Attributes
    ----------
    folder : Path
    remote : str
        The URL or folder that it fetches from.
    """

    folder: Path
    remote: str

    @classmethod
    def create(cls, folder: Path, remote: str) -> Repository:
        """Make an empty one.

        Raises
        ------
        BoardError
            Git is not installed, or the folder cannot be made.
        """
        folder.parent.mkdir(parents=True, exist_ok=True)
        made = cls(folder, remote)
        made._git.run("init", "--quiet", "--bare", "--template=")
        made._git.run("config", "remote.origin.url", remote)
        return made

    def fetch(self, refs: Mapping[str, str], *, blobs: bool, depth: int | None = None) -> None:
        """Fetch refs of the remote under names of our own.

        Parameters
        ----------
        refs : mapping of str to str
            The remote's name of each of ours, such as ``{"refs/pull/1/head": "refs/heads/head"}``.
        blobs : bool
            Whether the files' content comes along; else each file's when it is read.
        depth : int, optional
            How many commits; all where it is not given.

        Raises
        ------
        BoardError
            The remote cannot be reached, or lacks one of them.
        """
        options = [] if blobs else ["--filter=blob:none"]
        options += [] if depth is None else [f"--depth={depth}"]
        pairs = [f"+{theirs}:{ours}" for theirs, ours in refs.items()]
        self._git.run(
            "fetch", "--quiet", "--no-tags", "--no-recurse-submodules", "--no-write-fetch-head",
            *options, "origin", *pairs,
        )  # fmt: skip

    def remote_has(self, ref: str) -> bool:
        """Whether the remote has a ref."""
        return bool(self._git.run("ls-remote", "origin", ref).strip())

    def resolve(self, name: str) -> str | None:
        """Return the id of a commit or, for ``commit:path``, of a folder; None where there is none.

        Parameters
        ----------
        name : str
            Our own words only; a path in it has been checked.
        """
        done = self._git.call("rev-parse", "--verify", "--quiet", "--end-of-options", name)
        found = done.stdout.decode("ascii", "replace").strip()
        return found if done.returncode == 0 and _OBJECT_ID.fullmatch(found) else None

    def contains(self, ref: str, commit: str) -> bool:
        """Whether a commit is that of a ref of ours, or one before it."""
        return self._git.call("merge-base", "--is-ancestor", commit, ref).returncode == 0

    def merge_bases(self, one: str, other: str) -> list[str]:
        """Return the commits from which two commits went apart: more than one after merges."""
        done = self._git.call("merge-base", "--all", one, other)
        return done.stdout.decode("ascii").split() if done.returncode == 0 else []

    def changes(self, old: str, new: str, most: int) -> list[Change]:
        """Return the paths that differ between two commits; nothing is taken for renamed.

        Raises
        ------
        RefusedError
            They are more than `most`, or git cannot read the trees.
        """
        text = self._bounded(most, "diff-tree", "-r", "-z", "--raw", "--no-renames", old, new)
        fields = text.split(b"\0")[:-1]
        pairs = zip(fields[::2], fields[1::2], strict=True)
        found = [_change(head.decode("ascii"), path) for head, path in pairs]
        return _at_most(found, most)

    def entries(self, commit: str, folder: str, most: int) -> list[Entry]:
        """Return all files below a folder of a commit.

        Raises
        ------
        RefusedError
            They are more than `most`, or git cannot read the trees.
        """
        text = self._bounded(most, "ls-tree", "-r", "-z", "--full-tree", commit, "--", f"{folder}/")
        return _at_most([_entry(line) for line in text.split(b"\0")[:-1]], most)

    def folders(self, commit: str, folder: str) -> list[bytes]:
        """Return the paths of what lies directly in a folder of a commit."""
        text = self._git.run(
            "ls-tree", "-z", "--full-tree", "--name-only", commit, "--", f"{folder}/"
        )
        return text.split(b"\0")[:-1]

    def sizes(self, object_ids: Sequence[str]) -> Iterator[int]:
        """Yield the size of each object; those of a batch are fetched together, not more."""
        for start in range(0, len(object_ids), _BATCH):
            lines = "".join(f"{one}\n" for one in object_ids[start : start + _BATCH]).encode()
            # What this cannot bring, git itself fetches one by one when it is asked for.
            self._git.call(
                "-c", "fetch.negotiationAlgorithm=noop", "fetch", "--quiet", "--no-tags",
                "--no-recurse-submodules", "--no-write-fetch-head", "--filter=blob:none",
                "--stdin", "origin", stdin=lines,
            )  # fmt: skip
            found = self._git.run("cat-file", "--batch-check=%(objectsize)", stdin=lines)
            yield from map(int, found.split())

    def blob(self, object_id: str) -> bytes:
        """Return the content of a file whose size has been checked."""
        return self._git.run("cat-file", "blob", object_id)

    def write_blob(self, object_id: str, path: Path) -> None:
        """Write the content of a file whose size has been checked to a path that is free."""
        with path.open("xb") as stream:
            done = self._git.call("cat-file", "blob", object_id, stdout=stream.fileno())
        check(done, "cat-file")

    def commit(self, parent: str | None, files: Mapping[str, bytes], message: str) -> str:
        """Make a commit that adds or replaces files; there is no work tree.

        Parameters
        ----------
        parent : str or None
            None for the first commit of a branch.
        files : mapping of str to bytes
            By path.
        message : str
        """
        index = {"GIT_INDEX_FILE": str(self.folder / "index.new")}
        (self.folder / "index.new").unlink(missing_ok=True)
        if parent is not None:
            self._git.run("read-tree", parent, more=index)
        lines = [f"100644 {self._stored(text)}\t{path}\0" for path, text in files.items()]
        self._git.run(
            "update-index", "-z", "--index-info", stdin="".join(lines).encode(), more=index
        )
        tree = self._git.run("write-tree", "--missing-ok", more=index).decode("ascii").strip()
        parents = [] if parent is None else ["-p", parent]
        who = {
            f"GIT_{role}_{key}": value
            for role in ("AUTHOR", "COMMITTER")
            for key, value in (
                ("NAME", "leaderboard"),
                ("EMAIL", "leaderboard@users.noreply.github.com"),
            )
        }
        made = self._git.run("commit-tree", *parents, tree, stdin=message.encode(), more=who)
        return made.decode("ascii").strip()

    def push(self, commit: str, ref: str) -> bool:
        """Push a commit; False where the remote has moved on meanwhile.

        Raises
        ------
        BoardError
            The remote refuses it for another reason.
        """
        done = self._git.call("push", "--quiet", "--porcelain", "origin", f"{commit}:{ref}")
        if done.returncode and any(said in done.stdout for said in _OVERTAKEN):
            return False
        if done.returncode:
            done.stderr += done.stdout
        check(done, "push")
        return True

    def _stored(self, content: bytes) -> str:
        return self._git.run("hash-object", "-w", "--stdin", stdin=content).decode("ascii").strip()

    @property
    def _git(self) -> GitProcess:
        return GitProcess(self.folder, self.remote)

    def _bounded(self, most: int, *arguments: str) -> bytes:
        """Read what git prints as far as `most` entries can fill, and a little more."""
        limit = (most + 1) * _ENTRY_BYTES
        text, well = self._git.first_bytes(limit, *arguments)
        if len(text) == limit:
            raise _too_many(most)
        if not well:
            raise RefusedError("git cannot read the trees of this commit", fix="make it anew")
        return text


def _change(head: str, path: bytes) -> Change:
    old_mode, mode = head.removeprefix(":").split(" ")[:2]
    return Change(path, old_mode, mode)


def _entry(line: bytes) -> Entry:
    head, path = line.split(b"\t", 1)
    mode, _, object_id = head.decode("ascii").split(" ")
    return Entry(path, mode, object_id)


def _at_most(found: list[T], most: int) -> list[T]:
    if len(found) > most:
        raise _too_many(most)
    return found


def _too_many(most: int) -> RefusedError:
    return RefusedError(
        f"more than {most:,} files",
        expected="one submission",
        fix="put the predictions into one file, such as an .npz or a .zip, or give their URL",
    )
