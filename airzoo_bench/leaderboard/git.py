"""Git as a store of strangers' objects: no work tree of theirs, no filters, no hooks."""

from __future__ import annotations

import base64
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.checks import MOST_FILES

TOKEN_VARIABLE = "GIT_TOKEN"
"""The variable of the environment with a token for the remote; it never stands in arguments."""

_SETTINGS = {
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_ATTR_NOSYSTEM": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_ALLOW_PROTOCOL": "https:ssh:file",
    "LC_ALL": "C",
}
for _role in ("AUTHOR", "COMMITTER"):
    _SETTINGS[f"GIT_{_role}_NAME"] = "leaderboard"
    _SETTINGS[f"GIT_{_role}_EMAIL"] = "leaderboard@users.noreply.github.com"
_SAFE = ("-c", "core.hooksPath=/dev/null", "-c", "transfer.fsckObjects=true")
_FETCH = ("fetch", "--quiet", "--no-tags", "--no-recurse-submodules", "--no-write-fetch-head")
_LISTING_BYTES = (MOST_FILES + 1) * 512  # of an entry's line; paths are some thousand bytes at most
_EMPTY_TREE = "4b825dc642cb6eb9a060e54bf8d69288fbee4904"
_MOST_CHANGES = 100


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
        """Return the id of a commit or, for ``commit:path``, of a tree or file; None without one.

        The name is made of our own words; a path in it has been checked.
        """
        done = self.call("rev-parse", "--verify", "--quiet", "--end-of-options", name)
        return None if done.returncode else done.stdout.decode("ascii").strip()

    def changes(self, old: str, new: str, depth: int) -> list[tuple[str, bool]]:
        """Return which files and folders differ between two commits, and whether each is a folder.

        Folders that do are looked into up to a depth; no listing walks through a stranger's tree.
        """
        found, pending = [], [""]
        while pending:
            above = pending.pop()
            trees = [self.resolve(f"{at}:{above}") or _EMPTY_TREE for at in (old, new)]
            listed = self._listed("diff-tree", "-z", "--no-renames", *trees).split(b"\0")
            for about, name in zip(listed[::2], listed[1::2], strict=False):
                path, modes = f"{above}/{os.fsdecode(name)}".lstrip("/"), about[1:].split(b" ")[:2]
                is_folder = {*modes} <= {b"040000", b"000000"}
                if is_folder and path.count("/") < depth - 1:
                    pending.append(path)
                else:
                    found.append((path, is_folder))
            if len(found) + len(pending) > _MOST_CHANGES:
                what = f"changes more than {_MOST_CHANGES} folders, or files outside of them"
                raise RefusedError(what, fix="make a pull request for each submission")
        return found

    def entries(self, commit: str, folder: str) -> list[tuple[str, int, str]]:
        """Return path, mode and id of all files and folders below a folder of a commit."""
        text = self._listed("ls-tree", "-r", "-t", "-z", "--full-tree", f"{commit}:{folder}")
        found = []
        for line in text.split(b"\0")[:-1]:
            head, path = line.split(b"\t", 1)
            mode, _, object_id = head.decode("ascii").split(" ")
            found.append((os.fsdecode(path), int(mode, 8), object_id))
        return found

    def fetch_sizes(self, object_ids: Sequence[str]) -> list[int]:
        """Fetch the content of files, and return how large they are."""
        lines = "".join(f"{one}\n" for one in object_ids).encode()
        # Git itself fetches one by one, when asked, what this cannot bring.
        noop = ("-c", "fetch.negotiationAlgorithm=noop")
        self.call(*noop, *_FETCH, "--filter=blob:none", "--stdin", "origin", stdin=lines)
        found = self.run("cat-file", "--batch-check=%(objectsize)", stdin=lines)
        return [*map(int, found.split())]

    def _listed(self, *arguments: str) -> bytes:
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
