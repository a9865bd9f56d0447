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

_SHA256 = 64  # hexadecimal digits; SHA-1 has 40
_AGAIN = "run this again: what is there is kept"


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
            client = importlib.import_module("huggingface_hub")
        except ImportError as error:
            raise UsageError(
                "downloads need huggingface_hub, which is not installed",
                fix="pip install 'airzoo-bench[download]'",
            ) from error
        endpoint = os.environ.get("HF_ENDPOINT") or None
        library = {"library_name": "airzoo-bench", "library_version": __version__}
        self._api = client.HfApi(endpoint=endpoint, **library)
        self.page = f"{self._api.endpoint}/datasets/{repository}"
        if not sys.stderr.isatty():
            client.utils.disable_progress_bars()
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
        options = {"repo_type": "dataset", "revision": self.commit, "local_dir": folder}
        with self._explained(file.path):
            self._api.hf_hub_download(self.repository, file.path, **options)

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
                fix=f"visit {self.page}, accept its terms and wait to be let in where they ask for "
                "it; then: hf auth login",
            ) from error
        except (errors.HTTPError, errors.HfHubHTTPError, errors.LocalEntryNotFoundError) as error:
            cause = error.__cause__ or error
            answer = getattr(cause, "response", None)
            status = "" if answer is None else f" (status {int(answer.status_code)})"
            raise UsageError(
                f"cannot be fetched{status}: {str(cause).splitlines()[0]}",
                where=where,
                fix="look at the network, the proxy and HF_ENDPOINT, or at the login (hf auth "
                f"login), and {_AGAIN}",
            ) from error
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
    files: Sequence[HubFile]
    lacking: Sequence[HubFile]
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


def make_plan(folder: Path, files: Sequence[HubFile], progress: Progress) -> Plan:
    """Look which files are there already, and how much room the others need."""
    lacking: list[HubFile] = []
    strange: list[HubFile] = []
    for file in progress(files, "files", len(files)):
        target, noted = folder / file.path, _noted_digest(folder, file)
        if not target.is_file():
            lacking.append(file)
        elif file.digest not in (noted, _digest(target, file.digest)):
            of_earlier_commit = noted is not None and noted == _digest(target, noted)
            (lacking if of_earlier_commit else strange).append(file)
    if strange:
        raise BenchmarkError(
            "files of these names are there, and are not those that are published: "
            f"{first_of([repr(file.path) for file in strange], len(files))}",
            where=folder,
            fix="remove them, or name another folder with --to",
        )
    near = next(place for place in (folder, *folder.resolve().parents) if place.exists())
    needed, free = sum(file.size for file in lacking), shutil.disk_usage(near).free
    return Plan(folder, files, lacking, needed, free)


def _noted_digest(folder: Path, file: HubFile) -> str | None:
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
    with path.open("rb") as file:
        if len(like) == _SHA256:
            return hashlib.file_digest(file, "sha256").hexdigest()
        digest = hashlib.sha1(b"blob %d\0" % path.stat().st_size, usedforsecurity=False)
        return hashlib.file_digest(file, lambda: digest).hexdigest()
