"""Numbers as tables print them."""

from __future__ import annotations

import math
from typing import Literal

__all__ = ["is_wide", "share_to_percent", "show_number"]

_LARGEST = 1e9  # shown with all its digits


def share_to_percent(value: float) -> float:
    """Turn a share into percent."""
    return 100.0 * value


def is_wide(value: float | int | str | None) -> bool:
    """Whether a number is so large that only powers of ten keep its width bounded."""
    return isinstance(value, float) and abs(value) >= _LARGEST


def show_number(value: float, decimals: int, sign: Literal["-", "+"] = "-") -> str:
    """Return a number with so many digits after the point, an infinite one as ``inf``.

    From 1e9 on, the digits are those before a power of ten, such as ``1.00e+200``. What rounds to
    zero is not negative; with the sign "+" all other numbers have one.
    """
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return f"{value:{sign}z.{decimals}{'e' if is_wide(value) else 'f'}}"
