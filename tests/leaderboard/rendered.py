"""Comments, as a renderer of Markdown sees them."""

from __future__ import annotations

import re


def outside_code(text: str) -> str:
    """Return what a renderer of Markdown would look at: all but blocks and spans of code."""
    kept, fence = [], False
    for line in text.split("\n"):
        if line.startswith("````"):
            fence = not fence
        elif not fence:
            kept.append(re.sub(r"`[^`]*`", "", line))
    assert not fence
    return "\n".join(kept)
