"""Texts that want to be more than text, put wherever the board shows what strangers wrote."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle
from typing import Any

__all__ = ["ADDRESSES", "TEXTS", "spoilt"]

_CALL = "window.caught=(window.caught||0)+1"
TEXTS = (
    f"<script>{_CALL}</script>",
    f"</script><script>{_CALL}</script>",
    f"</title><img src=x onerror={_CALL}>",
    f'"><svg onload="{_CALL}">',
    f"' onmouseover='{_CALL}' x='",
    f"</style><body onload={_CALL}>",
    f"<!--<script>{_CALL}//-->",
    "{{ 7 * 191 }}{% for x in () %}",
    "${7 * 191} `${7 * 191}`",
    "]]></svg>&lt;b&gt;&#60;b&#62;",
    "abc\u202edcba\u2066\u2069\u200f",
    "\x1b[31mred\x1b[0m\x07\x00",
    "\u200b\u3164\u2800",
    " \t\n ",
    "x" * 4000,
    "a b " * 1000,
    "Z" + "\u0335\u0310\u0334" * 200,
    "\ufdfd" * 40,
    "name\u2028other\u2029line\r\nline",
    '=HYPERLINK("https://evil.example","x")',
    '<a href="javascript:alert(1)">x</a>',
    '<meta http-equiv="refresh" content="0;url=https://evil.example/">',
    '<link rel="stylesheet" href="https://evil.example/a.css">',
    '<base href="https://evil.example/">',
)
ADDRESSES = (
    f"javascript:{_CALL}",
    f"JaVaScRiPt:{_CALL}",
    f"data:text/html,<script>{_CALL}</script>",
    f'https://example.org/" onclick="{_CALL}',
    "https://user@evil.example/",
    "https://example.org/a b",
    "http://example.org/",
    "//evil.example/x",
    "https:///nowhere",
    "https://[::1",
    "vbscript:msgbox(1)",
    "https://example.org/\u202egpj.exe",
)
_SPOILT = {
    *("title", "method", "team", "source", "hardware", "licence", "why", "grade", "check"),
    *("printed_by", "printed_text", "rescored_text", "by", "changes", "made_with", "bibtex"),
    *("about", "about_ranks", "about_intervals", "apart", "benchmark_title", "stages"),
    *("summary", "protocol", "protocol_fingerprint", "truth", "benchmark"),
}
_LISTS = {"authors", "training_data", "notes", "labels", "uses"}


def spoilt(value: Any) -> Any:
    """Return a board's files with other texts and addresses."""
    return _spoilt(value, "", cycle(TEXTS), cycle(ADDRESSES))


def _spoilt(value: Any, key: str, texts: Iterator[str], addresses: Iterator[str]) -> Any:
    if isinstance(value, dict):
        return {k: _spoilt(v, k, texts, addresses) for k, v in value.items()}
    if isinstance(value, list) and key in _LISTS:
        return [next(texts) for _ in value]
    if isinstance(value, list):
        return [_spoilt(v, "", texts, addresses) for v in value]
    if key in ("paper", "code", "weights"):
        return next(addresses)
    return next(texts) if key in _SPOILT and isinstance(value, str) else value
