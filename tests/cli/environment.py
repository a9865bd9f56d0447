"""The environment of a command in a process of its own."""

from __future__ import annotations

import os


def environment(**more: str) -> dict[str, str]:
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return kept | more
