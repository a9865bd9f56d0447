"""What strangers wrote, as a page may show it: one line, no invisible letters, plain addresses."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache
from typing import Any
from urllib.parse import urlsplit

__all__ = ["host_of", "plain_name", "printed", "safe_url", "shown", "visible"]

_MOST = 300
_MARKS = 3  # on one letter: no script of today needs more, and a pile of them covers other lines
_HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
# Letters by their category, and nothing to see.
_BLANK = frozenset("\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0")
_URL = re.compile(r"https://[^\s<>\"'`\\]+")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_MARKUP = frozenset("&<>\"'")
_UNNAMED = "(no visible text)"


def shown(text: object, most: int = _MOST) -> str:
    """Return a text as it may stand in a page; it is still to be escaped."""
    return _shown(str(text), most)


@lru_cache(maxsize=4096)  # a table's names stand on each of its pages
def _shown(text: str, most: int) -> str:
    line = " ".join(text.split())
    visible, marks = [], 0
    for letter in line[: 4 * most]:
        kind = unicodedata.category(letter)
        marks = marks + 1 if kind in ("Mn", "Me") else 0
        if marks <= _MARKS:
            visible.append("\N{REPLACEMENT CHARACTER}" if kind in _HIDDEN else letter)
    if all(letter in _BLANK or letter in " \N{REPLACEMENT CHARACTER}" for letter in visible):
        return _UNNAMED
    found = "".join(visible)
    return found if len(found) <= most else found[: most - 1] + "…"


def visible(value: Any) -> Any:
    """Return what a page is about to print, without letters that are not seen but line breaks."""
    if not isinstance(value, str) or hasattr(value, "__html__") or value.isprintable():
        return value
    return "".join(
        "\N{REPLACEMENT CHARACTER}" if unicodedata.category(c) in _HIDDEN and c != "\n" else c
        for c in value
    )


def printed(text: str) -> str:
    """Return a text as a template prints it: `visible`, and escaped."""
    if text.isprintable() and _MARKUP.isdisjoint(text):
        return text
    from markupsafe import escape  # of Jinja, without which no page is made

    return str(escape(visible(text)))


def safe_url(address: object) -> str | None:
    """Return an address that may stand in a link: https, a host, no user; None of any other."""
    if not isinstance(address, str) or not _URL.fullmatch(address) or not address.isprintable():
        return None
    return address if host_of(address) else None


def host_of(address: str) -> str | None:
    """Return the host that an address leads to; None where it has none, or names a user."""
    try:
        parts = urlsplit(address)
        return None if "@" in parts.netloc else parts.hostname
    except ValueError:
        return None


def plain_name(name: str) -> str:
    """Return a name of the board's own as it stands in paths."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no plain name")
    return name
