"""Whether messages name only options that the command has."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any


def foreign_options(words: list[str], message: str) -> set[str]:
    """Return options of the suite that a message names as if the command had them, and it has not.

    What the user wrote, and calls of other commands ("`prepare --copy`", "prepare with --copy"),
    may be named.
    """
    import typer

    from airzoo_bench.cli.main import app, options_of

    root: Any = typer.main.get_command(app)
    own = options_of(root, words) | {word.partition("=")[0] for word in words}
    said = re.sub(
        r"`[^`]*`( with --[\w-]+)?|airzoo-bench .*|prepare (it again )?with --\w+", "", message
    )
    foreign = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+(?![\w-])", said)) - own
    return foreign & _all_options(root) if foreign else set()


@lru_cache(maxsize=1)
def _all_options(group: Any) -> frozenset[str]:
    own = frozenset(name for one in group.params for name in one.opts)
    if not hasattr(group, "list_commands"):
        return own
    commands = (group.get_command(None, name) for name in group.list_commands(None))
    return own.union(*map(_all_options.__wrapped__, commands))
