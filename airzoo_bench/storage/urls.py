"""Locations: paths of this machine, URLs, and the paths that copies of URLs have."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote, unquote

from platformdirs import user_cache_path

from airzoo_bench.core.errors import UsageError

SCHEMES = ("s3", "gs", "hf", "https", "http")
CACHE_VARIABLE = "AIRZOO_BENCH_CACHE"
"""The variable of the environment that names the folder of copies."""
_BEGIN = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")


@dataclass(frozen=True)
class Url:
    """A place in a storage."""

    scheme: str
    path: str  # host or bucket, then names, without a last slash; of https without percent signs
    query: str = ""  # of a file at https, such as a signature; messages do not show it
    says_folder: bool = False  # it had a last slash: a file and a folder may have one name

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.path.rpartition("/")[2]

    @property
    def address(self) -> str:
        """The whole of it, for a client."""
        path = quote(self.path, "/:[]") if self.read_only else self.path
        return f"{self.scheme}://{path}" + (f"?{self.query}" if self.query else "")

    @property
    def read_only(self) -> bool:
        """Whether nothing can be written there."""
        return self.scheme.startswith("http")

    def child(self, relative: str) -> Url:
        """Return the place of a file below."""
        if not _is_plain(relative):
            raise UsageError(
                f"has a file that would not lie in its folder: {relative[:80]!r}",
                where=self,
                expected="relative names without '..'",
            )
        return replace(self, path=f"{self.path}/{relative}", says_folder=False)

    def __str__(self) -> str:
        return f"{self.scheme}://{self.path}" + "?…" * bool(self.query)


def _is_plain(path: str) -> bool:
    return not ({"", ".", ".."} & set(path.split("/")) or {"\\", "\0"} & set(path))


def is_url(location: object) -> bool:
    """Tell whether a location is written as a URL."""
    return _BEGIN.match(str(location)) is not None


def url_of(location: str | Path) -> Url | None:
    """Return the URL that a location is, or None where it is a path."""
    text = str(location)
    found = _BEGIN.match(text)
    if found is None:
        return None
    scheme, path, query = found[1].lower(), text[found.end() :], ""
    if scheme.startswith("http"):
        path, _, query = path.partition("#")[0].partition("?")
        if "@" in path.partition("/")[0]:
            raise UsageError(
                "a URL with a login",
                where=f"{scheme}://…",
                fix="put name and password into ~/.netrc, and leave them out of the URL",
            )
        path = unquote(path)
    if scheme not in SCHEMES or not _is_plain(path.rstrip("/")) or "?versionId=" in path:
        raise UsageError(
            "is no URL that is read here",
            where=f"{scheme}://…",
            expected=f"{', '.join(f'{one}://' for one in SCHEMES)}, then a bucket or host and a "
            "folder or file, of which the newest version is read",
        )
    return Url(scheme, path.rstrip("/"), query, says_folder=path.endswith("/"))


def cache_folder() -> Path:
    """Return the folder of copies: AIRZOO_BENCH_CACHE, else one of the user's cache."""
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named).expanduser().absolute() if named else user_cache_path("airzoo-bench/mirrors")


def copy_of(url: Url) -> Path:
    """Return the path of the copy of a file or folder, which may not be there."""
    return cache_folder() / url.scheme / url.path


def url_at(path: Path) -> Url | None:
    """Return the URL whose copy a path is, or None."""
    try:
        scheme, *names = path.absolute().relative_to(cache_folder()).parts
    except ValueError:
        return None
    return Url(scheme, "/".join(names)) if scheme in SCHEMES and names else None


def in_urls(text: str) -> str:
    """Return a message in which copies are called by their URLs."""
    for scheme in SCHEMES:
        text = text.replace(f"{cache_folder() / scheme}/", f"{scheme}://")
    return text
