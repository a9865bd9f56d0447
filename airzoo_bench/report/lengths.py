"""Widths and heights of pictures, as people give them."""

from __future__ import annotations

import re

from airzoo_bench.core.errors import UsageError

__all__ = ["parse_length"]

_LEAST_IN = {"--width": 2.0, "--height": 1.0}
_MOST_IN = 40.0
_CM = 2.54


def parse_length(text: str, option: str = "--width") -> float:
    """Turn ``8.4cm`` or ``3.3in`` into inches.

    Parameters
    ----------
    text : str
    option : {"--width", "--height"}

    Raises
    ------
    UsageError
        It is no length, or beyond 2 to 40 inches of width, 1 to 40 of height.
    """
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*(cm|in)", text.strip().lower())
    if not found:
        raise UsageError(f"{option} {text!r} is no {option[2:]}", expected="such as 3.3in or 8.4cm")
    length = float(found[1]) / (_CM if found[2] == "cm" else 1.0)
    least = _LEAST_IN[option]
    if not least <= length <= _MOST_IN:
        raise UsageError(
            f"{option} {text} is too {'small' if length < least else 'large'}",
            expected=f"between {least:g}in and {_MOST_IN:g}in",
        )
    return length
