"""The description of a dataset, in a TOML file, and its download from Hugging Face."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import BenchmarkError, UsageError, readable
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
    has not been seen. `scene_files` are patterns (`fnmatch`) of the paths in the repository that
    are of one scene alone. `options` are texts of the command's options, with bounds of numbers;
    those of ``about/options.toml`` need not be repeated.
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
    keys = f"the keys {', '.join(About.__dataclass_fields__)}"
    with readable(path, "is no about-text", kind=BenchmarkError, expected=keys, fix="correct it"):
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


def fetch_from_hub(repository: str, left_out: Sequence[str], folder: Path, *, dry_run: bool) -> Any:
    """Fetch the files of a dataset on Hugging Face that are not there; or list all instead."""
    try:
        client = importlib.import_module("huggingface_hub")
    except ImportError as error:
        raise UsageError(
            "downloads need huggingface_hub, which is not installed",
            fix="pip install 'airzoo-bench[download]'",
        ) from error
    page = f"https://huggingface.co/datasets/{repository}"
    fix = f"visit {page}, accept its terms and wait to be let in where they ask for it, then: "
    fix += "hf auth login; look at the network and the disk, and run this again"
    with readable(page, "cannot be fetched", kind=UsageError, fix=fix):
        return client.snapshot_download(
            repo_id=repository,
            repo_type="dataset",
            local_dir=folder,
            ignore_patterns=list(left_out),
            library_name="airzoo-bench",
            library_version=__version__,
            dry_run=dry_run,
        )
