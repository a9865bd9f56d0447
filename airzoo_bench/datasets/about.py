"""What a published benchmark says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["About"]


@dataclass(frozen=True)
class About:
    """What users want to know of a benchmark before they have it.

    Attributes
    ----------
    title : str
        Such as "UAV-VisLoc".
    page : str
        Address of the page that tells where to get it.
    licence : str
        As the benchmark states it, or that it states none.
    repository : str or None
        The dataset's id on Hugging Face, where the data lie there.
    links : tuple of str
        Addresses of the files, where they can be fetched by link.
    assumptions : tuple of str
        A sentence for each value that the truth rests on and that the benchmark does not state.
    unverified : tuple of str
        A sentence for each part of the layout that nobody of us has seen.
    scene_files : mapping of str to tuple of str
        Patterns (`fnmatch`) of the paths in the repository that are of one scene alone, by its id,
        for `download --scene`; empty where scenes cannot be fetched by themselves.
    """

    title: str
    page: str
    licence: str
    repository: str | None = None
    links: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    scene_files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
