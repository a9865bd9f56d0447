"""What a dataset says of itself, in a TOML file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["About", "about_file", "about_of", "read_about"]


@dataclass(frozen=True)
class About:
    """What users want to know of a dataset before they have it.

    Attributes
    ----------
    title : str
        Such as "UAV-VisLoc".
    summary : str
        What is made of it, for the help: a sentence, then what else there is to say.
    example : str
        What stands behind ``airzoo-bench prepare``, for the help.
    page : str
        Address of the page that tells where to get it.
    licence : str
        As a published benchmark states it, or that it states none; empty for own data.
    repository : str or None
        The dataset's id on Hugging Face, where the data lie there.
    links : tuple of str
        Addresses of the files, where they can be fetched by link.
    assumptions : tuple of str
        A sentence for each value that the truth rests on and that the benchmark does not state.
    unverified : tuple of str
        A sentence for each part of the layout that has not been seen.
    without_truth : mapping of str to str
        Why a track may have no truth, by the track's name.
    scene_files : mapping of str to tuple of str
        Patterns (`fnmatch`) of the paths in the repository that are of one scene alone, by its id,
        for `download --scene`; empty where scenes cannot be fetched by themselves.
    """

    title: str
    summary: str
    example: str
    page: str = ""
    licence: str = ""
    repository: str | None = None
    links: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    without_truth: Mapping[str, str] = field(default_factory=dict)
    scene_files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def is_published(self) -> bool:
        """Whether it is a benchmark that others publish."""
        return bool(self.licence)


def about_file(name: str) -> Path:
    """Return the file of a built-in dataset, which others do not have."""
    return Path(__file__).parent / "about" / f"{name}.toml"


def about_of(name: str) -> About:
    """Return what a built-in dataset says of itself."""
    return read_about(about_file(name))


def read_about(path: Path) -> About:
    """Read a TOML file that has the attributes of `About` as its keys."""
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    lists = {key: tuple(value) for key, value in values.items() if isinstance(value, list)}
    files = {scene: tuple(found) for scene, found in values.get("scene_files", {}).items()}
    return About(**{**values, **lists, "scene_files": files})
