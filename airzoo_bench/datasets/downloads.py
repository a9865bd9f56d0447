"""Fetching a published benchmark from Hugging Face, its files verified."""

from __future__ import annotations

import errno
import hashlib
import importlib
import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.version import __version__

__all__ = ["HubDataset", "HubFile", "Plan", "download", "of_scenes", "planned"]

_HOME = ".airzoo-bench"
_LIST = "verified.json"
_BLOCK = 1 << 20
_SHA256 = 64  # hexadecimal digits; SHA-1 has 40
_TOO_LARGE = 50_000_000_000  # the hub serves larger files by a protocol of its own, not by HTTP
_STATUS = {
    401: ("the login is not valid, or there is no such dataset", "hf auth login"),
    403: ("this login may not read it", "hf auth login, with a token that may read gated datasets"),
    404: ("is not there", "look at the page whether it has moved"),
    429: ("too many requests", "wait, and run this again; hf auth login raises the limit"),
}


@dataclass(frozen=True)
class HubFile:
    """A file of a dataset.

    `digest` is SHA-256 for files in large file storage, else SHA-1 as git computes it.
    """

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
        self._endpoint = os.environ.get("HF_ENDPOINT") or None
        library = {"library_name": "airzoo-bench", "library_version": __version__}
        self._api = self._client.HfApi(endpoint=self._endpoint, **library)
        self._headers = self._client.utils.build_hf_headers(**library)
        self.page = f"{self._api.endpoint}/datasets/{repository}"
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
        for file in found:
            parts = PurePosixPath(file.path).parts
            if not parts or file.path[0] == "/" or {"..", "\\", ":"} & {*parts, *file.path}:
                raise BenchmarkError(
                    f"the list has a path that leads elsewhere: {file.path[:80]!r}",
                    where=self.page,
                    expected="paths below the dataset",
                )
        return sorted(found, key=lambda file: file.path)

    def fetch(self, file: HubFile, part: Path) -> None:
        """Fetch a file's bytes behind those that `part` has already."""
        if file.size > _TOO_LARGE:
            raise UsageError(
                f"{file.path} is {file.size / 1e9:.0f} GB, more than can be fetched by HTTP",
                where=self.page,
                fix=f"hf download --repo-type dataset {self.repository} {file.path!r} "
                "--local-dir DIR, then run this again",
            )
        place = {"repo_type": "dataset", "revision": self.commit, "endpoint": self._endpoint}
        url = self._client.hf_hub_url(self.repository, file.path, **place)
        if not sys.stderr.isatty():
            self._client.utils.disable_progress_bars()
        fetching = importlib.import_module("huggingface_hub.file_download")
        with self._explained(file.path), part.open("ab") as target:
            fetching.http_get(
                url,
                target,
                resume_size=target.tell(),
                headers=self._headers,
                expected_size=file.size,
                displayed_filename=file.path,
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
        except errors.HfHubHTTPError as error:
            status = int(error.response.status_code)
            what, fix = _STATUS.get(status, ("the server fails", "run this again later"))
            raise UsageError(f"{what} (status {status})", where=where, fix=fix) from error
        except errors.HTTPError as error:
            raise UsageError(
                f"cannot be reached: {error or type(error).__name__}",
                where=where,
                fix="look at the network, the proxy and HF_ENDPOINT, and run this again: what is "
                "there is kept",
            ) from error
        except OSError as error:
            if error.strerror is not None or error.errno is not None:
                raise
            # The client's own word for a body that is shorter or longer than announced.
            what = str(error).splitlines()[0]
            raise BenchmarkError(what, where=where, fix="run this again") from error


@dataclass(frozen=True)
class Plan:
    """What a download has to do.

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
    others = [one for scene, of in patterns.items() if scene not in scenes for one in of]
    wanted = [one for scene in scenes for one in patterns[scene]]
    for scene in scenes:
        if not any(fnmatchcase(file.path, one) for file in files for one in patterns[scene]):
            raise UsageError(
                f"no file of scene {scene} is listed",
                where="--scene",
                expected=" or ".join(patterns[scene]),
                fix="leave --scene out to fetch all, and name scenes at `prepare`",
            )
    return [
        file
        for file in files
        if any(fnmatchcase(file.path, one) for one in wanted)
        or not any(fnmatchcase(file.path, one) for one in others)
    ]


def planned(folder: Path, files: Sequence[HubFile], progress: Progress) -> Plan:
    """Look which files are there already, and how much room the others need."""
    record = _read_record(folder)
    lacking: list[HubFile] = []
    strange: list[str] = []
    for file in progress(files, "files", len(files)):
        target = folder / file.path
        if not target.is_file():
            lacking.append(file)
        elif record.get(file.path) != _entry(target, file):
            if _digest(target, file.digest) == file.digest:
                record[file.path] = _entry(target, file)
            else:
                ours = str(record.get(file.path, {}).get("digest"))
                if _digest(target, ours) == ours:  # of an earlier commit
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
    _write_record(folder, record)
    needed = sum(file.size - _size(_part(folder, file)) for file in lacking)
    near = next(place for place in (folder, *folder.resolve().parents) if place.exists())
    return Plan(folder, tuple(files), tuple(lacking), needed, shutil.disk_usage(near).free)


def download(plan: Plan, source: HubDataset, progress: Progress) -> None:
    """Fetch the lacking files; each appears when it is whole and verified."""
    record = _read_record(plan.folder)
    for file in progress(plan.lacking, "files", len(plan.lacking)):
        part, target = _part(plan.folder, file), plan.folder / file.path
        try:
            part.parent.mkdir(parents=True, exist_ok=True)
            _fetch_verified(file, part, source, plan.folder)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            raise UsageError(
                "the disk is full",
                where=plan.folder,
                fix="make room and run this again: what is there is kept",
            ) from error
        target.parent.mkdir(parents=True, exist_ok=True)
        part.replace(target)
        record[file.path] = _entry(target, file)
        _write_record(plan.folder, record)


def _fetch_verified(file: HubFile, part: Path, source: HubDataset, folder: Path) -> None:
    """Fetch a file; what was begun and turns out wrong is fetched once more from the start."""
    for last in (_size(part) == 0, True):
        if _size(part) > file.size:
            part.unlink()
        if _size(part) < file.size or not part.exists():
            source.fetch(file, part)
        if _size(part) == file.size and _digest(part, file.digest) == file.digest:
            return
        part.unlink(missing_ok=True)
        if last:
            break
    raise BenchmarkError(
        f"{file.path} is damaged: what came is not what the dataset's list says",
        where=folder,
        expected=f"{file.size} bytes with the checksum {file.digest}",
        fix="run this again; where it stays so, tell the owners of the dataset",
    )


def _entry(target: Path, file: HubFile) -> dict[str, Any]:
    status = target.stat()
    return {"digest": file.digest, "size": status.st_size, "modified_ns": status.st_mtime_ns}


def _part(folder: Path, file: HubFile) -> Path:
    return folder / _HOME / f"{file.digest}.part"


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _digest(path: Path, like: str) -> str:
    """Return the checksum of the kind that another one is of."""
    digest = hashlib.sha256()
    if len(like) != _SHA256:
        digest = hashlib.sha1(b"blob %d\0" % _size(path), usedforsecurity=False)
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _read_record(folder: Path) -> dict[str, dict[str, Any]]:
    """Return what was verified before; nothing where that cannot be read."""
    try:
        found = json.loads((folder / _HOME / _LIST).read_text(encoding="utf-8"))
        return {path: dict(entry) for path, entry in found.items()}
    except (FileNotFoundError, ValueError, AttributeError, TypeError):
        return {}  # then files are verified by their bytes


def _write_record(folder: Path, record: Mapping[str, Any]) -> None:
    if record:
        (folder / _HOME).mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / _HOME / _LIST, "w") as file:
            json.dump(record, file, indent=1, sort_keys=True)
