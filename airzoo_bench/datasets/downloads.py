"""Fetching a published benchmark from Hugging Face by its own client."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UsageError, readable
from airzoo_bench.core.version import __version__


def others_patterns(patterns: Mapping[str, Sequence[str]], scenes: Sequence[str]) -> list[str]:
    """Return the patterns of files that only other scenes need; none if all are wanted."""
    wanted = {one for scene in scenes for one in patterns[scene]}
    others = {
        one for scene in patterns if scenes and scene not in scenes for one in patterns[scene]
    }
    return sorted(others - wanted)


class HubDataset:
    """A dataset on Hugging Face; patterns leave out some files."""

    def __init__(self, repository: str, left_out: Sequence[str], folder: Path) -> None:
        try:
            self._client = importlib.import_module("huggingface_hub")
        except ImportError as error:
            raise UsageError(
                "downloads need huggingface_hub, which is not installed",
                fix="pip install 'airzoo-bench[download]'",
            ) from error
        self.page = f"https://huggingface.co/datasets/{repository}"
        self._options: dict[str, Any] = {"repo_id": repository, "repo_type": "dataset"}
        self._options |= {"local_dir": folder, "ignore_patterns": list(left_out)}
        self._options |= {"library_name": "airzoo-bench", "library_version": __version__}

    def sizes(self) -> list[int]:
        """Return the sizes in bytes of the files that are to be fetched."""
        return [file.file_size for file in self._download(dry_run=True) if file.will_download]

    def fetch(self) -> None:
        """Fetch what is not there, behind what an earlier run fetched."""
        self._download()

    def _download(self, **options: Any) -> Any:
        fix = f"visit {self.page}, accept its terms and wait to be let in where they ask for it, "
        fix += "then: hf auth login; look at the network and the disk, and run this again"
        with readable(self.page, "cannot be fetched", kind=UsageError, fix=fix):
            return self._client.snapshot_download(**self._options, **options)
