"""Git as a store of strangers' objects: bare repositories, no work tree, no filters, no hooks."""

from __future__ import annotations

import base64
import os
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.errors import SubmissionError

__all__ = ["TOKEN_VARIABLE", "BoardError", "Change", "Entry", "RefusedError", "Repository"]

TOKEN_VARIABLE = "GIT_TOKEN"
"""The variable of the environment with a token for the remote; it never stands in arguments."""

T = TypeVar("T")

_OBJECT_ID = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
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
_ENTRY_BYTES = 512  # of an entry's line, on average; paths are at most some thousand bytes long
# What git says where somebody else has pushed since, before or while this push was received.
_OVERTAKEN = (b"[rejected]", b"cannot lock ref", b"failed to update ref", b"incorrect old value")
_TIMEOUT_S = 1800


class BoardError(SubmissionError):
    """The board, its data or its remote is not as it must be: no fault of a submission."""


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
        made._run("init", "--quiet", "--bare", "--template=", str(folder), bare=False)
        made._run("config", "remote.origin.url", remote)
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
        self._run(
            "fetch", "--quiet", "--no-tags", "--no-recurse-submodules", "--no-write-fetch-head",
            *options, "origin", *pairs,
        )  # fmt: skip

    def remote_has(self, ref: str) -> bool:
        """Whether the remote has a ref."""
        return bool(self._run("ls-remote", "origin", ref).strip())

    def resolve(self, name: str) -> str | None:
        """Return the id of a commit or, for ``commit:path``, of a folder; None where there is none.

        Parameters
        ----------
        name : str
            Our own words only; a path in it has been checked.
        """
        done = self._call("rev-parse", "--verify", "--quiet", "--end-of-options", name)
        found = done.stdout.decode("ascii", "replace").strip()
        return found if done.returncode == 0 and _OBJECT_ID.fullmatch(found) else None

    def contains(self, ref: str, commit: str) -> bool:
        """Whether a commit is that of a ref of ours, or one before it."""
        return self._call("merge-base", "--is-ancestor", commit, ref).returncode == 0

    def merge_base(self, one: str, other: str) -> str | None:
        """Return the commit from which two commits went apart."""
        done = self._call("merge-base", one, other)
        return done.stdout.decode("ascii").strip() if done.returncode == 0 else None

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
        text = self._run("ls-tree", "-z", "--full-tree", "--name-only", commit, "--", f"{folder}/")
        return text.split(b"\0")[:-1]

    def sizes(self, object_ids: Sequence[str]) -> Iterator[int]:
        """Yield the size of each object, asked for one after the other."""
        for object_id in object_ids:
            yield int(self._run("cat-file", "-s", object_id))

    def blob(self, object_id: str) -> bytes:
        """Return the content of a file whose size has been checked."""
        return self._run("cat-file", "blob", object_id)

    def write_blob(self, object_id: str, path: Path) -> None:
        """Write the content of a file whose size has been checked to a path that is free."""
        with path.open("xb") as stream:
            done = self._call("cat-file", "blob", object_id, stdout=stream.fileno())
        _check(done, "cat-file")

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
            self._run("read-tree", parent, more=index)
        lines = [f"100644 {self._stored(text)}\t{path}\0" for path, text in files.items()]
        self._run("update-index", "-z", "--index-info", stdin="".join(lines).encode(), more=index)
        tree = self._run("write-tree", "--missing-ok", more=index).decode("ascii").strip()
        parents = [] if parent is None else ["-p", parent]
        who = {
            f"GIT_{role}_{key}": value
            for role in ("AUTHOR", "COMMITTER")
            for key, value in (
                ("NAME", "leaderboard"),
                ("EMAIL", "leaderboard@users.noreply.github.com"),
            )
        }
        made = self._run("commit-tree", *parents, tree, stdin=message.encode(), more=who)
        return made.decode("ascii").strip()

    def push(self, commit: str, ref: str) -> bool:
        """Push a commit; False where the remote has moved on meanwhile.

        Raises
        ------
        BoardError
            The remote refuses it for another reason.
        """
        done = self._call("push", "--quiet", "--porcelain", "origin", f"{commit}:{ref}")
        if done.returncode and any(said in done.stdout for said in _OVERTAKEN):
            return False
        if done.returncode:
            done.stderr += done.stdout
        _check(done, "push")
        return True

    def _stored(self, content: bytes) -> str:
        return self._run("hash-object", "-w", "--stdin", stdin=content).decode("ascii").strip()

    def _bounded(self, most: int, *arguments: str) -> bytes:
        """Read what git prints as far as `most` entries can fill, and a little more."""
        limit = (most + 1) * _ENTRY_BYTES
        with subprocess.Popen(
            self._line(arguments), env=self._environment(), stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        ) as process:  # fmt: skip
            text = process.stdout.read(limit) if process.stdout else b""
            if len(text) == limit:
                process.kill()
                raise _too_many(most)
        if process.returncode:
            raise RefusedError(
                "git cannot read the trees of this commit", fix="make the commit anew"
            )
        return text

    def _run(
        self,
        *arguments: str,
        stdin: bytes = b"",
        more: Mapping[str, str] | None = None,
        bare: bool = True,
    ) -> bytes:
        done = self._call(*arguments, stdin=stdin, more=more, bare=bare)
        _check(done, arguments[0])
        return done.stdout or b""

    def _call(
        self,
        *arguments: str,
        stdin: bytes = b"",
        more: Mapping[str, str] | None = None,
        stdout: int = subprocess.PIPE,
        bare: bool = True,
    ) -> subprocess.CompletedProcess[bytes]:
        line = self._line(arguments) if bare else ["git", *arguments]
        try:
            return subprocess.run(
                line, input=stdin, env=self._environment() | dict(more or {}), stdout=stdout,
                stderr=subprocess.PIPE, timeout=_TIMEOUT_S, check=False,
            )  # fmt: skip
        except FileNotFoundError as error:
            raise BoardError("git is not installed", fix="install git 2.36 or later") from error
        except subprocess.TimeoutExpired as error:
            raise BoardError(
                f"git {arguments[0]} took longer than {_TIMEOUT_S} s", where=self.remote
            ) from error

    def _line(self, arguments: Sequence[str]) -> list[str]:
        return ["git", "-c", "core.hooksPath=/dev/null", f"--git-dir={self.folder}", *arguments]

    def _environment(self) -> dict[str, str]:
        kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
        token = os.environ.get(TOKEN_VARIABLE)
        if not token or not self.remote.startswith("https://"):
            return kept | _SETTINGS
        basic = base64.b64encode(f"x-access-token:{token}".encode()).decode("ascii")
        return (
            kept
            | _SETTINGS
            | {
                "GIT_CONFIG_COUNT": "1",
                "GIT_CONFIG_KEY_0": f"http.{self.remote}.extraHeader",
                "GIT_CONFIG_VALUE_0": f"Authorization: Basic {basic}",
            }
        )


def _check(done: subprocess.CompletedProcess[bytes], name: str) -> None:
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip()[-500:]
        raise BoardError(f"git {name} failed: {said or f'exit code {done.returncode}'}")


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
