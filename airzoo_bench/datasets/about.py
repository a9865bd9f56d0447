"""The description of a dataset, in a TOML file, and its download from Hugging Face."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UsageError, readable
from airzoo_bench.core.registry import Option
from airzoo_bench.core.version import __version__


@dataclass(frozen=True)
class About:
    """The description of a dataset, for users who do not have it yet.

    `summary` (a sentence, then what else there is to say) and `example` (what stands behind
    ``airzoo-bench prepare``) are for the help. `page` tells where to get the data, `licence` is as
    stated, empty for own data; `repository` is an id on Hugging Face, `links` are addresses of
    files. `layout` describes the files that are read. `assumptions` has a sentence for each value
    that the truth rests on and that is not stated, `unverified` for each part of the layout that
    has not been seen. `without_truth` says why a track may have no truth; `scene_files` are
    patterns (`fnmatch`) of the paths in the repository that are of one scene alone. `options` are
    texts of the command's options, with bounds of numbers; those of ``about/options.toml`` need
    not be repeated.
    """

    title: str
    summary: str
    example: str
    page: str = ""
    licence: str = ""
    repository: str | None = None
    links: tuple[str, ...] = ()
    layout: str = ""
    assumptions: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    without_truth: Mapping[str, str] = field(default_factory=dict)
    scene_files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    options: Mapping[str, Option] = field(default_factory=dict)

    @property
    def is_published(self) -> bool:
        """Whether it is a benchmark that others publish."""
        return bool(self.licence)


def about_file(name: str) -> Path:
    """Return the file of a built-in dataset, which others do not have."""
    return Path(__file__).parent / "about" / f"{name}.toml"


def load_about(name: str) -> About:
    """Return what a built-in dataset says of itself."""
    return read_about(about_file(name))


def read_about(path: Path) -> About:
    """Read a TOML file that has the attributes of `About` as its keys."""
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    lists = {key: tuple(value) for key, value in values.items() if isinstance(value, list)}
    files = {scene: tuple(found) for scene, found in values.get("scene_files", {}).items()}
    shared = tomllib.loads(about_file("options").read_text(encoding="utf-8"))
    options = {
        name: Option(name, **(text if isinstance(text, dict) else {"help": text}))
        for name, text in (shared | values.get("options", {})).items()
    }
    return About(**{**values, **lists, "scene_files": files, "options": options})


# --- downloads ---


def patterns_to_skip(patterns: Mapping[str, Sequence[str]], scenes: Sequence[str]) -> list[str]:
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
