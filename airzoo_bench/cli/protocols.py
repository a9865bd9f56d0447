"""``airzoo-bench protocols``: what can be measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, put, say, show
from airzoo_bench.cli.locations import DataOption, resolve_data

if TYPE_CHECKING:
    from airzoo_bench.datasets.about import About
    from airzoo_bench.protocol.model import Protocol

EXAMPLES = examples("protocols uav-visloc-retrieval")
_IN_A_TERMINAL = ("Protocol", "Track", "Scenes", "Queries")
_TITLES = (*_IN_A_TERMINAL, "Version", "Fingerprint", "Title", "Data", "Licence", "Assumed")


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
    from airzoo_bench.tables.model import Cell, Column, Row, Table

    folder = resolve_data(data)
    if name is not None:
        protocol = find_protocol(name, folder)
        path = Path(name) if name.endswith(".toml") else protocol_files(folder)[name]
        put(_about_lines(_about(protocol.benchmark)) + path.read_text(encoding="utf-8"))
        return
    loaded = {key: load_protocol(path) for key, path in protocol_files(folder).items()}
    rows = tuple(Row(tuple(map(Cell, _values(key, one)))) for key, one in loaded.items())
    table = Table("Protocols", tuple(map(Column, _TITLES)), rows)
    if form is Format.TERMINAL:
        say("protocols NAME prints one and what is assumed of its data; --format json has all")
        few = len(_IN_A_TERMINAL)
        rows = tuple(replace(row, cells=row.cells[:few]) for row in rows)
        table = replace(table, columns=table.columns[:few], rows=rows)
    show(table, form)


def _values(key: str, protocol: Protocol) -> tuple[str | int, ...]:
    about = _about(protocol.benchmark)
    # Published counts are of the whole benchmark, not of what a folder holds of it.
    partial = protocol.benchmark.endswith("-partial")
    counts = [s.queries for s in protocol.scenes if s.queries is not None and not partial]
    queries = sum(counts) if len(counts) == len(protocol.scenes) else ""
    first = (key, protocol.track, len(protocol.scenes), queries)
    data = (
        ("", "", "") if about is None else (about.page, about.licence, " ".join(about.assumptions))
    )
    return (*first, protocol.version, protocol.fingerprint[:12], protocol.title, *data)


def _about(benchmark: str) -> About | None:
    """Return what is known of a benchmark's data, where a dataset of that name says it."""
    from airzoo_bench.core.registry import DATASETS
    from airzoo_bench.datasets.about import about_file, about_of

    name = benchmark.removesuffix("-partial")
    if about_file(name).is_file():
        return about_of(name)
    return DATASETS.get(name).about if name in DATASETS else None


def _about_lines(about: About | None) -> str:
    """Return what is known of the data as comments, so that the whole is still a protocol file."""
    if about is None:
        return ""
    lines = [f"{about.title}: {about.page}", f"licence: {about.licence}"]
    lines += [f"assumed: {sentence}" for sentence in about.assumptions]
    lines += [f"not verified: {sentence}" for sentence in about.unverified]
    return "".join(f"# {line}\n" for line in lines)
