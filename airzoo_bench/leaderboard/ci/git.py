"""Git as a store of strangers' objects: bare repositories, no work tree, no filters, no hooks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.ci.git_process import BoardError, GitProcess, check

__all__ = ["BoardError", "Change", "Entry", "RefusedError", "Repository"]

_OBJECT_ID = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
_ENTRY_BYTES = 512  # of an entry's line, on average; paths are at most some thousand bytes long
_BATCH = 64
_FOLDER = "040000"
_COMPARED = 4  # parts of the path of a submission's folder: what lies deeper is part of that
_MOST_CHILDREN = 20_000
# What git says where somebody else has pushed since, before or while this push was received.
_OVERTAKEN = (b"[rejected]", b"cannot lock ref", b"failed to update ref", b"incorrect old value")


class RefusedError(SubmissionError):
    """A pull request is not as it must be."""


@dataclass(frozen=True)
class Change:
    """A path that differs between two commits: a file, or a folder as a whole."""

    path: bytes
    is_folder: bool


@dataclass(frozen=True)
class Entry:
    """A file of a commit, or a folder."""

    path: bytes
    mode: str
    object_id: str


@dataclass(frozen=True)
class Repository:
    """A bare repository that only fetches, reads and pushes objects."""

    git: GitProcess

    @classmethod
    def create(cls, folder: Path, remote: str) -> Repository:
        """Make an empty one."""
        folder.parent.mkdir(parents=True, exist_ok=True)
        made = cls(GitProcess(folder, remote))
        made.git.run("init", "--quiet", "--bare", "--template=")
        made.git.run("config", "remote.origin.url", remote)
        return made

    def fetch(self, refs: Mapping[str, str], *, blobs: bool, depth: int | None = None) -> None:
        """Fetch refs of the remote under names of our own."""
        options = [] if blobs else ["--filter=blob:none"]
        options += [] if depth is None else [f"--depth={depth}"]
        pairs = [f"+{theirs}:{ours}" for theirs, ours in refs.items()]
        done = self.git.call(
            "fetch", "--quiet", "--no-tags", "--no-recurse-submodules", "--no-write-fetch-head",
            *options, "origin", *pairs,
        )  # fmt: skip
        if b"find remote ref" in done.stderr:
            raise BoardError(
                done.stderr.decode("utf-8", "replace").strip().removeprefix("fatal: "),
                where=self.git.remote,
                expected=f"{' and '.join(refs)} there",
                fix="correct --remote, the name of the board's branch, or the event: a pull "
                "request that was deleted has no ref",
            )
        check(done, "fetch")

    def remote_has(self, ref: str) -> bool:
        """Whether the remote has a ref."""
        return bool(self.git.run("ls-remote", "origin", ref).strip())

    def resolve(self, name: str) -> str | None:
        """Return the id of a commit or, for ``commit:path``, of a folder; None where there is none.

        Parameters
        ----------
        name : str
            Our own words only; a path in it has been checked.
        """
        done = self.git.call("rev-parse", "--verify", "--quiet", "--end-of-options", name)
        found = done.stdout.decode("ascii", "replace").strip()
        return found if done.returncode == 0 and _OBJECT_ID.fullmatch(found) else None

    def contains(self, ref: str, commit: str) -> bool:
        """Whether a commit is that of a ref of ours, or one before it."""
        return self.git.call("merge-base", "--is-ancestor", commit, ref).returncode == 0

    def merge_bases(self, one: str, other: str) -> list[str]:
        """Return the commits from which two commits went apart: more than one after merges."""
        done = self.git.call("merge-base", "--all", one, other)
        return done.stdout.decode("ascii").split() if done.returncode == 0 else []

    def changes(self, old: str, new: str, most: int) -> list[Change]:
        """Return the paths that differ between two commits, at most so many."""
        return [*islice(self._changes(old, new), most)]

    def _changes(self, old: str | None, new: str | None, path: bytes = b"") -> Iterator[Change]:
        before, now = self._children(old), self._children(new)
        differing = sorted(n for n in before.keys() | now.keys() if before.get(n) != now.get(n))
        if not differing:
            yield Change(path, is_folder=True)
        for name in differing:
            sides = before.get(name), now.get(name)
            below = b"/".join(filter(None, (path, name)))
            is_folder = all(side is None or side.mode == _FOLDER for side in sides)
            if is_folder and below.count(b"/") < _COMPARED - 1:
                yield from self._changes(_id(sides[0]), _id(sides[1]), below)
            else:
                yield Change(below, is_folder)

    def _children(self, tree: str | None) -> dict[bytes, Entry]:
        if tree is None:
            return {}
        text = self._bounded(_MOST_CHILDREN, "ls-tree", "-z", "--full-tree", tree)
        return {one.path: one for one in map(_entry, text.split(b"\0")[:-1])}

    def entries(self, commit: str, folder: str, most: int) -> list[Entry]:
        """Return all files below a folder of a commit, and the folders without any."""
        # With folders (-t), so that a tree of empty ones is cut off as one of files is.
        text = self._bounded(
            most, "ls-tree", "-r", "-t", "-z", "--full-tree", commit, "--", f"{folder}/"
        )
        listed = _no_parents([_entry(line) for line in text.split(b"\0")[:-1]])
        found = [one for one in listed if (one.path + b"/").startswith(f"{folder}/".encode())]
        if len(found) > most:
            raise _too_many(most)
        return found

    def folders(self, commit: str, folder: str) -> list[bytes]:
        """Return the paths of what lies directly in a folder of a commit."""
        text = self.git.run(
            "ls-tree", "-z", "--full-tree", "--name-only", commit, "--", f"{folder}/"
        )
        return text.split(b"\0")[:-1]

    def sizes(self, object_ids: Sequence[str]) -> Iterator[int]:
        """Yield the size of each object; those of a batch are fetched together, not more."""
        for start in range(0, len(object_ids), _BATCH):
            lines = "".join(f"{one}\n" for one in object_ids[start : start + _BATCH]).encode()
            # What this cannot bring, git itself fetches one by one when it is asked for.
            self.git.call(
                "-c", "fetch.negotiationAlgorithm=noop", "fetch", "--quiet", "--no-tags",
                "--no-recurse-submodules", "--no-write-fetch-head", "--filter=blob:none",
                "--stdin", "origin", stdin=lines,
            )  # fmt: skip
            found = self.git.run("cat-file", "--batch-check=%(objectsize)", stdin=lines)
            yield from map(int, found.split())

    def blob(self, object_id: str) -> bytes:
        """Return the content of a file whose size has been checked."""
        return self.git.run("cat-file", "blob", object_id)

    def write_blob(self, object_id: str, path: Path) -> None:
        """Write the content of a file whose size has been checked to a path that is free."""
        with path.open("xb") as stream:
            done = self.git.call("cat-file", "blob", object_id, stdout=stream.fileno())
        check(done, "cat-file")

    def commit(self, parent: str | None, files: Mapping[str, bytes], message: str) -> str:
        """Make a commit that adds or replaces files; there is no work tree."""
        index = {"GIT_INDEX_FILE": str(self.git.folder / "index.new")}
        (self.git.folder / "index.new").unlink(missing_ok=True)
        if parent is not None:
            self.git.run("read-tree", parent, more=index)
        lines = [f"100644 {self._stored(text)}\t{path}\0" for path, text in files.items()]
        self.git.run(
            "update-index", "-z", "--index-info", stdin="".join(lines).encode(), more=index
        )
        tree = self.git.run("write-tree", "--missing-ok", more=index).decode("ascii").strip()
        parents = [] if parent is None else ["-p", parent]
        who = {
            f"GIT_{role}_{key}": value
            for role in ("AUTHOR", "COMMITTER")
            for key, value in (
                ("NAME", "leaderboard"),
                ("EMAIL", "leaderboard@users.noreply.github.com"),
            )
        }
        made = self.git.run("commit-tree", *parents, tree, stdin=message.encode(), more=who)
        return made.decode("ascii").strip()

    def push(self, commit: str, ref: str) -> bool:
        """Push a commit; False where the remote has moved on meanwhile."""
        done = self.git.call("push", "--quiet", "--porcelain", "origin", f"{commit}:{ref}")
        if done.returncode and any(said in done.stdout for said in _OVERTAKEN):
            return False
        if done.returncode:
            done.stderr += done.stdout
        check(done, "push")
        return True

    def _stored(self, content: bytes) -> str:
        return self.git.run("hash-object", "-w", "--stdin", stdin=content).decode("ascii").strip()

    def _bounded(self, most: int, *arguments: str) -> bytes:
        """Read what git prints as far as `most` entries can fill, and a little more."""
        limit = (most + 1) * _ENTRY_BYTES
        text, well = self.git.first_bytes(limit, *arguments)
        if len(text) == limit:
            raise _too_many(most)
        if not well:
            raise RefusedError("git cannot read the trees of this commit", fix="make it anew")
        return text


def _entry(line: bytes) -> Entry:
    head, path = line.split(b"\t", 1)
    mode, _, object_id = head.decode("ascii").split(" ")
    return Entry(path, mode, object_id)


def _id(entry: Entry | None) -> str | None:
    return None if entry is None else entry.object_id


def _no_parents(found: Sequence[Entry]) -> list[Entry]:
    """Leave out folders in which there is anything."""
    parents = {one.path.rpartition(b"/")[0] for one in found}
    return [one for one in found if one.path not in parents]


def _too_many(most: int) -> RefusedError:
    return RefusedError(
        f"more than {most:,} files and folders",
        expected="one submission",
        fix="put the predictions into one file, such as an .npz or a .zip, or give their URL",
    )
