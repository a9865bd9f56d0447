"""``airzoo-bench protocols``: what can be measured."""

from __future__ import annotations

import shutil
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, put, say, show
from airzoo_bench.cli.locations import DataOption, resolve_data

if TYPE_CHECKING:
    from airzoo_bench.datasets.about import About
    from airzoo_bench.protocol.model import Protocol
    from airzoo_bench.tables.model import Row, Table

__all__ = ["EXAMPLES", "protocols"]

EXAMPLES = examples("protocols uav-visloc-retrieval")


def protocols(
    name: Annotated[
        str | None, typer.Argument(help="Print this protocol's file.", show_default=False)
    ] = None,
    data: DataOption = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """List the protocols that are shipped or stand in prepared benchmark folders.

    With a name: its file, and what is known of the benchmark's data.
    """
    from airzoo_bench.protocol.lookup import find_protocol, load_protocol, protocol_files
    from airzoo_bench.tables.model import Column, Table

    folder = resolve_data(data)
    if name is not None:
        protocol = find_protocol(name, folder)
        path = Path(name) if name.endswith(".toml") else protocol_files(folder)[name]
        put(_about_lines(_about(protocol.benchmark)) + path.read_text(encoding="utf-8"))
        return
    if form is Format.TERMINAL:
        say("protocols NAME prints one and what is assumed of its data; --format json has all")
    loaded = {key: load_protocol(path) for key, path in protocol_files(folder).items()}
    rows = tuple(_row(key, protocol) for key, protocol in loaded.items())
    table = Table("Protocols", tuple(map(Column, _TITLES)), rows)
    show(_narrow(table) if form is Format.TERMINAL else table, form)


_TITLES = (
    *("Protocol", "Version", "Track", "Scenes", "Queries", "Fingerprint", "Title"),
    *("Data", "Licence", "Assumed"),
)


_IN_A_TERMINAL = ("Protocol", "Track", "Scenes", "Queries")


def _narrow(table: Table) -> Table:
    """Keep the columns that fit a terminal."""
    kept = [_TITLES.index(title) for title in _IN_A_TERMINAL]
    rows = [replace(row, cells=tuple(row.cells[i] for i in kept)) for row in table.rows]
    return replace(table, columns=tuple(table.columns[i] for i in kept), rows=tuple(rows))


def _row(key: str, protocol: Protocol) -> Row:
    from airzoo_bench.tables.model import Cell, Row

    about = _about(protocol.benchmark)
    # Published counts are of the whole benchmark, not of what a folder holds of it.
    partial = protocol.benchmark.endswith("-partial")
    counts = [s.queries for s in protocol.scenes if s.queries is not None and not partial]
    assumed = () if about is None else about.assumptions
    values = (
        *(key, protocol.version, protocol.track, len(protocol.scenes)),
        sum(counts) if len(counts) == len(protocol.scenes) else "",
        *(protocol.fingerprint[:12], protocol.title),
        "" if about is None else about.page,
        "" if about is None else about.licence,
        " ".join(assumed),
    )
    return Row(tuple(map(Cell, values)))


def _about(benchmark: str) -> About | None:
    """Return what is known of a benchmark's data, where a dataset of that name says it."""
    from airzoo_bench.core.registry import DATASETS
    from airzoo_bench.datasets.about import about_file, about_of

    name = benchmark.removesuffix("-partial")
    if about_file(name).is_file():
        return about_of(name)
    return DATASETS.get(name).about if name in DATASETS.names() else None


def _about_lines(about: About | None) -> str:
    """Return what is known of the data as comments, so that the whole is still a protocol file."""
    if about is None:
        return ""
    lines = [f"{about.title}: {about.page}", f"licence: {about.licence}"]
    lines += [f"assumed: {sentence}" for sentence in about.assumptions]
    lines += [f"not verified: {sentence}" for sentence in about.unverified]
    width = shutil.get_terminal_size((80, 24)).columns
    return "".join(f"{_comment(line, width)}\n" for line in lines)


def _comment(line: str, width: int) -> str:
    """Wrap a comment at the terminal's width, but no address."""
    return textwrap.fill(
        line,
        max(width, 40),
        initial_indent="# ",
        subsequent_indent="#   ",
        break_long_words=False,
        break_on_hyphens=False,
    )
