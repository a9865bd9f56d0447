"""Datasets on Hugging Face: what files they have, and fetching one; its client is imported here."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any

from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError
from airzoo_bench.core.version import __version__

__all__ = ["HubDataset", "HubFile"]

_TOO_LARGE = 50_000_000_000
"""The hub serves larger files by a protocol of its own, not by HTTP."""


@dataclass(frozen=True)
class HubFile:
    """A file of a dataset.

    Attributes
    ----------
    path : str
        Relative to the dataset.
    size : int
        Bytes.
    digest : str
        SHA-256 of files in large file storage, else SHA-1 as git computes it.
    """

    path: str
    size: int
    digest: str


class HubDataset:
    """A dataset on Hugging Face, at the commit that is its newest when this is made.

    Parameters
    ----------
    repository : str
        Its id, such as "name/data".

    Raises
    ------
    UserError
        huggingface_hub is not installed; the dataset cannot be reached, does not exist, or access
        to it must be asked for.
    """

    def __init__(self, repository: str) -> None:
        self.repository = repository
        self._client = _client()
        self._endpoint = os.environ.get("HF_ENDPOINT") or None
        self._api = self._client.HfApi(
            endpoint=self._endpoint,
            library_name="airzoo-bench",
            library_version=__version__,
        )
        self.page = f"{self._api.endpoint}/datasets/{repository}"
        with self._explained():
            info = self._api.dataset_info(repository)
            if info.gated:
                self._api.auth_check(repository, repo_type="dataset")
        self.commit = str(info.sha)

    def files(self) -> list[HubFile]:
        """Return all files, sorted by path."""
        with self._explained():
            entries = list(
                self._api.list_repo_tree(
                    self.repository, recursive=True, revision=self.commit, repo_type="dataset"
                )
            )
        found = [
            HubFile(entry.path, entry.size, entry.lfs.sha256 if entry.lfs else entry.blob_id)
            for entry in entries
            if hasattr(entry, "blob_id")
        ]
        for file in found:
            _check_path(file.path, self.page)
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
        url = self._client.hf_hub_url(
            self.repository,
            file.path,
            repo_type="dataset",
            revision=self.commit,
            endpoint=self._endpoint,
        )
        if not sys.stderr.isatty():
            self._client.utils.disable_progress_bars()
        fetching = importlib.import_module("huggingface_hub.file_download")
        with self._explained(file.path), part.open("ab") as target:
            fetching.http_get(
                url,
                target,
                resume_size=target.tell(),
                headers=self._client.utils.build_hf_headers(
                    library_name="airzoo-bench", library_version=__version__
                ),
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
        except errors.RepositoryNotFoundError as error:
            raise UsageError(
                "there is no such dataset, or it is private",
                where=where,
                fix="look at the page; where you may see it: hf auth login, and run this again",
            ) from error
        except errors.HfHubHTTPError as error:
            raise _refused(error, where) from error
        except errors.HTTPError as error:
            raise UsageError(
                f"cannot be reached: {error or type(error).__name__}",
                where=where,
                fix="look at the network, the proxy and HF_ENDPOINT, and run this again: what is "
                "there is kept",
            ) from error
        except OSError as error:
            if error.strerror is None and error.errno is None:
                # The client's own word for a body that is shorter or longer than announced.
                raise BenchmarkError(
                    str(error).splitlines()[0], where=where, fix="run this again"
                ) from error
            raise


_OF_STATUS = {
    401: (
        "the login is not valid, or there is no such dataset",
        "hf auth login, with a token that may read",
    ),
    403: ("this login may not read it", "hf auth login, with a token that may read gated datasets"),
    404: ("is not there", "look at the page whether it has moved"),
    429: ("too many requests", "wait, and run this again; hf auth login raises the limit"),
}


def _refused(error: Any, where: str) -> UserError:
    status = int(error.response.status_code)
    what, fix = _OF_STATUS.get(status, ("the server fails", "run this again later"))
    return UsageError(f"{what} (status {status})", where=where, fix=fix)


def _client() -> ModuleType:
    try:
        return importlib.import_module("huggingface_hub")
    except ImportError as error:
        raise UsageError(
            "downloads need huggingface_hub, which is not installed",
            fix="pip install 'airzoo-bench[download]'",
        ) from error


def _check_path(path: str, where: str) -> None:
    parts = PurePosixPath(path).parts
    if not parts or path.startswith("/") or ".." in parts or "\\" in path or ":" in path:
        raise BenchmarkError(
            f"the list has a path that leads elsewhere: {path[:80]!r}",
            where=where,
            expected="paths below the dataset",
        )
