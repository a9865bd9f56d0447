"""``airzoo-bench cache``: what is kept on this machine, and its removal."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import examples, printable, put, say, working
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.places import data_location
from airzoo_bench.core.plurals import counted, sized

if TYPE_CHECKING:
    from collections.abc import Sequence

    from airzoo_bench.storage.inventory import Kept

__all__ = ["EXAMPLES", "cache"]

EXAMPLES = examples("cache", "cache --remove-older-than 30")

_DAY_S = 86_400.0


def cache(
    remove_older_than: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="DAYS",
            help="Remove what was not used for so many days and is made or fetched again where it "
            "is missed; 0: all of that. No run may be under way.",
            show_default=False,
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing.")] = False,
) -> None:
    """List what is kept to save time: mirrors of URLs, fetched predictions, worlds, maps.

    Benchmark folders, and the worlds and maps that these read, are never removed.
    """
    with working("looking through what is kept"):
        found = _found()
    now = time.time()
    if remove_older_than is None:
        _list(found, now)
        return
    old = [one for one in found if one.spare and now - one.used_s >= remove_older_than * _DAY_S]
    _list(old, now)
    if old:
        _remove(old, yes=yes)


def _found() -> list[Kept]:
    from airzoo_bench.storage.inventory import kept_in, kept_in_cache

    data = data_location()
    if not isinstance(data, Path):
        return kept_in_cache()
    return [
        *kept_in_cache(),
        *kept_in(data / "fetched-predictions", "predictions", "[0-9a-f]{64}", spare=True),
        *kept_in(data / "mini-worlds", "world", ".*", spare=False),
        *kept_in(data / "made", "maps", ".*", spare=False),
        *kept_in(data / "surfaces", "surface", ".*", spare=False),
    ]


def _list(kept: Sequence[Kept], now: float) -> None:
    for one in kept:
        days = counted(int(max(now - one.used_s, 0.0) / _DAY_S), "day")
        stays = "" if one.spare else " (stays)"
        put(f"{sized(one.size):>10}  {days:>10}  {one.kind + stays:24}  {printable(one.what)}\n")
    say(f"{counted(len(kept), 'folder')}, {sized(sum(one.size for one in kept))}")


def _remove(old: Sequence[Kept], *, yes: bool) -> None:
    from airzoo_bench.storage.inventory import remove

    if not yes and not sys.stdin.isatty():
        raise UsageError("nothing was removed: nobody can be asked", fix="add --yes")
    if not yes:
        typer.confirm("Remove these?", default=False, abort=True, err=True)
    for one in old:
        remove(one)
    say(f"removed {counted(len(old), 'folder')}: {sized(sum(one.size for one in old))} are free")
