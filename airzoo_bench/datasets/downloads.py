"""Fetching a published benchmark from Hugging Face by its own client, each file verified."""

from __future__ import annotations

import errno
import hashlib
import importlib
import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.version import __version__

__all__ = ["HubDataset", "HubFile", "Plan", "download", "of_scenes", "planned"]

_SHA256 = 64  # hexadecimal digits; SHA-1 has 40
_AGAIN = "run this again: what is there is kept"
_STATUS = {
    401: ("the login is not valid, or there is no such dataset", "hf auth login"),
    403: ("this login may not read it", "hf auth login, with a token that may read gated datasets"),
    404: ("is not there", "look at the page whether it has moved"),
    429: ("too many requests", "wait, and run this again; hf auth login raises the limit"),
}


@dataclass(frozen=True)
class HubFile:
    """A file of a dataset; `digest` is SHA-256 for large files, else SHA-1 as git computes it."""

    path: str
    size: int
    digest: str


class HubDataset:
    """A dataset on Hugging Face, at the commit that is its newest when this is made."""

    def __init__(self, repository: str) -> None:
        self.repository = repository
        try:
            self._client = importlib.import_module("huggingface_hub")
        except ImportError as error:
            raise UsageError(
                "downloads need huggingface_hub, which is not installed",
                fix="pip install 'airzoo-bench[download]'",
            ) from error
        endpoint = os.environ.get("HF_ENDPOINT") or None
        library = {"library_name": "airzoo-bench", "library_version": __version__}
        self._api = self._client.HfApi(endpoint=endpoint, **library)
        self.page = f"{self._api.endpoint}/datasets/{repository}"
        if not sys.stderr.isatty():
            self._client.utils.disable_progress_bars()
        with self._explained():
            info = self._api.dataset_info(repository)
            if info.gated:
                self._api.auth_check(repository, repo_type="dataset")
        self.commit = str(info.sha)

    def files(self) -> list[HubFile]:
        """Return all files, sorted by path."""
        options = {"recursive": True, "revision": self.commit, "repo_type": "dataset"}
        with self._explained():
            entries = list(self._api.list_repo_tree(self.repository, **options))
        found = [
            HubFile(entry.path, entry.size, entry.lfs.sha256 if entry.lfs else entry.blob_id)
            for entry in entries
            if hasattr(entry, "blob_id")
        ]
        return sorted(found, key=lambda file: file.path)

    def fetch(self, file: HubFile, folder: Path) -> None:
        """Fetch a file into its place below a folder, behind what an earlier run fetched."""
        with self._explained(file.path):
            self._api.hf_hub_download(
                self.repository,
                file.path,
                repo_type="dataset",
                revision=self.commit,
                local_dir=folder,
            )

    @contextmanager
    def _explained(self, path: str = "") -> Iterator[None]:
        """Turn what the client raises into messages."""
        errors = importlib.import_module("huggingface_hub.errors")
        where = f"{self.page}, {path}" if path else self.page
        try:
            yield
        except errors.GatedRepoError as error:
            raise UsageError(
                "access to this dataset must be asked for",
                where=where,
                expected="an account that its owners have let in, and a login of this machine",
                fix=f"visit {self.page}, accept its terms and wait to be let in where they ask for "
                "it; then: hf auth login",
            ) from error
        except (errors.HTTPError, errors.HfHubHTTPError, errors.LocalEntryNotFoundError) as error:
            cause = error.__cause__ or error
            answer = getattr(cause, "response", None)
            what = f"cannot be reached: {cause}"
            fix = f"look at the network, the proxy and HF_ENDPOINT, and {_AGAIN}"
            if answer is not None:
                status = int(answer.status_code)
                what, fix = _STATUS.get(status, ("the server fails", _AGAIN))
                what += f" (status {status})"
            raise UsageError(what, where=where, fix=fix) from error
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                fix = f"make room and {_AGAIN}"
                raise UsageError("the disk is full", where=where, fix=fix) from error
            if error.errno is not None:
                raise
            # The client's own word for a body that is shorter or longer than announced.
            what = str(error).splitlines()[0]
            raise BenchmarkError(what, where=where, fix=_AGAIN) from error


@dataclass(frozen=True)
class Plan:
    """The work of a download.

    `lacking` are to fetch, `needed` bytes of them; `free` is the room on the disk.
    """

    folder: Path
    files: tuple[HubFile, ...]
    lacking: tuple[HubFile, ...]
    needed: int
    free: int


def of_scenes(
    files: Sequence[HubFile], patterns: Mapping[str, Sequence[str]], scenes: Sequence[str]
) -> list[HubFile]:
    """Return the files of some scenes, and those that belong to none."""
    for scene in scenes:
        if not any(_fits(file, patterns[scene]) for file in files):
            raise UsageError(
                f"no file of scene {scene} is listed",
                where="--scene",
                expected=" or ".join(patterns[scene]),
                fix="leave --scene out to fetch all, and name scenes at `prepare`",
            )
    others = [one for scene, of in patterns.items() if scene not in scenes for one in of]
    wanted = [one for scene in scenes for one in patterns[scene]]
    return [file for file in files if _fits(file, wanted) or not _fits(file, others)]


def _fits(file: HubFile, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(file.path, one) for one in patterns)


def planned(folder: Path, files: Sequence[HubFile], progress: Progress) -> Plan:
    """Look which files are there already, and how much room the others need."""
    lacking: list[HubFile] = []
    strange: list[str] = []
    for file in progress(files, "files", len(files)):
        target = folder / file.path
        ours = _fetched_digest(folder, file)
        if not target.is_file():
            lacking.append(file)
        elif file.digest not in (ours, _digest(target, file.digest)):
            if ours is not None and ours == _digest(target, ours):  # of an earlier commit
                lacking.append(file)
            else:
                strange.append(file.path)
    if strange:
        raise BenchmarkError(
            "files of these names are there, and are not those that are published: "
            f"{first_of(map(repr, strange), len(files))}",
            where=folder,
            fix="remove them, or name another folder with --to",
        )
    near = next(place for place in (folder, *folder.resolve().parents) if place.exists())
    needed, free = sum(file.size for file in lacking), shutil.disk_usage(near).free
    return Plan(folder, tuple(files), tuple(lacking), needed, free)


def _fetched_digest(folder: Path, file: HubFile) -> str | None:
    """Return the digest that the client noted of a file, if that was not written to since."""
    note = folder / ".cache/huggingface/download" / f"{file.path}.metadata"
    try:
        _, digest, when = note.read_text().split()
        changed = (folder / file.path).stat().st_mtime > float(when) + 1.0
    except (OSError, ValueError):
        return None
    return None if changed else digest


def download(plan: Plan, source: HubDataset, progress: Progress) -> None:
    """Fetch the lacking files, and hold each to the digest of the dataset's list."""
    for file in progress(plan.lacking, "files", len(plan.lacking)):
        source.fetch(file, plan.folder)
        target = plan.folder / file.path
        if _digest(target, file.digest) != file.digest:
            target.unlink()
            raise BenchmarkError(
                f"{file.path} is damaged: what came is not what the dataset's list says",
                where=plan.folder,
                expected=f"{file.size} bytes with the checksum {file.digest}",
                fix="run this again; where it stays so, tell the owners of the dataset",
            )


def _digest(path: Path, like: str) -> str:
    """Return the checksum of a file, SHA-256 or SHA-1 like another checksum."""
    digest = hashlib.sha256()
    if len(like) != _SHA256:
        size = path.stat().st_size
        digest = hashlib.sha1(b"blob %d\0" % size, usedforsecurity=False)
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
