"""Real repositories for tests: a hosted board, forks, and trees that no program would make."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

AUTHOR = {
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_AUTHOR_NAME": "someone",
    "GIT_AUTHOR_EMAIL": "someone@example.org",
    "GIT_COMMITTER_NAME": "someone",
    "GIT_COMMITTER_EMAIL": "someone@example.org",
}

File = bytes | tuple[str, bytes]
"""The content of a plain file, or another mode and the content (or, of a submodule, the commit)."""


def git(folder: Path, *arguments: str, stdin: bytes = b"") -> str:
    """Run git and return what it prints."""
    done = subprocess.run(
        ["git", *arguments], cwd=folder, input=stdin, capture_output=True, env=os.environ | AUTHOR
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().strip()


@dataclass(frozen=True)
class Hosted:
    """A bare repository as GitHub keeps it, with main and pull requests."""

    folder: Path

    @classmethod
    def create(cls, folder: Path, files: Mapping[str, File]) -> Hosted:
        folder.mkdir(parents=True)
        git(folder, "init", "--quiet", "--bare", "--initial-branch=main")
        git(folder, "config", "uploadpack.allowFilter", "true")
        made = cls(folder)
        made.move("refs/heads/main", made.commit(None, files))
        return made

    def commit(self, parent: str | None, files: Mapping[str, File | None]) -> str:
        """Commit files on top of a parent, by plumbing: None removes one."""
        index = self.folder / "index.tests"
        index.unlink(missing_ok=True)
        settings = AUTHOR | {"GIT_INDEX_FILE": str(index)}

        def run(*arguments: str, stdin: bytes = b"") -> str:
            done = subprocess.run(
                ["git", *arguments], cwd=self.folder, input=stdin, capture_output=True,
                env=os.environ | settings,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr.decode()
            return done.stdout.decode().strip()

        if parent is not None:
            run("read-tree", parent)
        blobs: dict[bytes, str] = {}
        lines = []
        for name, file in files.items():
            path = os.fsencode(name)
            if file is None:
                lines.append(b"0 " + b"0" * 40 + b"\t" + path + b"\0")
                continue
            mode, content = file if isinstance(file, tuple) else ("100644", file)
            if content not in blobs:
                blobs[content] = (
                    content.decode()
                    if mode == "160000"
                    else run("hash-object", "-w", "--stdin", stdin=content)
                )
            lines.append(f"{mode} {blobs[content]}\t".encode() + path + b"\0")
        run("update-index", "-z", "--index-info", stdin=b"".join(lines))
        tree = run("write-tree")
        parents = [] if parent is None else ["-p", parent]
        return run("commit-tree", *parents, tree, stdin=b"a change\n")

    def commit_tree(self, parent: str, tree: str) -> str:
        return git(self.folder, "commit-tree", "-p", parent, tree, stdin=b"a tree\n")

    def move(self, ref: str, commit: str) -> None:
        git(self.folder, "update-ref", ref, commit)

    def tip(self, branch: str = "main") -> str:
        return git(self.folder, "rev-parse", f"refs/heads/{branch}")

    def pull(self, number: int, head: str) -> None:
        """Let a pull request point to a commit, as after a push to it."""
        self.move(f"refs/pull/{number}/head", head)

    def pull_of(self, number: int, files: Mapping[str, File | None], parent: str = "") -> str:
        """Open a pull request with files on top of main, and return its head."""
        head = self.commit(parent or self.tip(), files)
        self.pull(number, head)
        return head


def event(number: int, head: str, account: int = 7, **more: Any) -> dict[str, Any]:
    """Return what GitHub tells a workflow of a pull request, with fields that nobody reads."""
    return {
        "action": "synchronize",
        "number": number,
        "pull_request": {
            "number": number,
            "title": "`$(id)` ${{ github.token }}",
            "head": {"sha": head, "ref": "$(reboot)", "label": "x:y", "repo": {"fork": True}},
            "base": {"ref": "main", "sha": "0" * 40},
            "user": {"login": "someone", "id": account, "type": "User"},
            "merged": False,
            **more,
        },
        "repository": {"full_name": "lab/board", "default_branch": "main"},
        "sender": {"id": 1},
    }


def write_event(path: Path, content: dict[str, Any]) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path
