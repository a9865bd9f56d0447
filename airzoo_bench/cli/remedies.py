"""Ways to mend a fault that the command at hand has.

Library code is called by many commands, and says how to mend a fault in all of them: "raise
--max-memory, or sample the mesh".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

__all__ = ["options_of", "own_ways"]

# Options that library code names, and that not every command has which calls it.
_SHARED = {
    "--data", "--depth", "--engine", "--force", "--image-size", "--jobs", "--max-memory",
    "--names", "--out", "--protocol", "--reader", "--resume", "--scheduler",
}  # fmt: skip
_OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
_OTHER_CALL = re.compile(r"`[^`]*`(?: with --\w+)?")
_OR = ", or "


def options_of(root: Any, words: Sequence[str]) -> set[str]:
    """Return the options of the command that words of a command line name."""
    return {name for one in _command(root, iter(words)).params for name in one.opts}


def _command(group: Any, words: Iterator[str]) -> Any:
    if not hasattr(group, "get_command"):
        return group
    found = group.get_command(None, next(words, ""))
    return group if found is None else _command(found, words)


def own_ways(fix: str | None, options: set[str]) -> str | None:
    """Leave out ways to mend a fault, with ", or " between, by options that a command lacks."""
    foreign = _SHARED - options
    ways = [
        way
        for way in (fix or "").split(_OR)
        if foreign.isdisjoint(_OPTION.findall(_OTHER_CALL.sub("", way)))
    ]
    return _OR.join(ways) or None
