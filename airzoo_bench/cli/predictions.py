"""``airzoo-bench check``, ``template`` and ``readers``: prediction files before they are scored."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    Format,
    FormatOption,
    ImageSizeOption,
    MemoryOption,
    NamesOption,
    ProtocolOption,
    ReaderOption,
    UntrustedOption,
    memory_bytes,
    put,
    say,
    show_rows,
)
from airzoo_bench.cli.locations import DataOption, predictions_here, resolve_data, with_data


class Kind(StrEnum):
    """The content of a prediction file."""

    RANKED_IDS = "ranked-ids"
    DESCRIPTORS = "descriptors"


def check(
    predictions: Annotated[
        str,
        typer.Argument(
            metavar="PREDICTIONS",
            help="A prediction file, folder or archive of any track: a path or a URL.",
        ),
    ],
    protocol: ProtocolOption = None,
    data: DataOption = None,
    reader: ReaderOption = None,
    names: NamesOption = None,
    image_size: ImageSizeOption = None,
    max_memory: MemoryOption = "2G",
    untrusted: UntrustedOption = False,
) -> None:
    """Find errors in predictions, name their reader and how many queries they answer.

    Exit code 0: eval would take them; 1: it would refuse them; 2: there is nothing to check, as
    with no file or an unknown protocol.

    Needs the benchmark folder, whose truth may be sealed, and finds whatever eval would refuse: in
    each file or scene, the first error.
    """
    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.evaluate import check as find_errors
    from airzoo_bench.evaluation.opening import ReadBy
    from airzoo_bench.evaluation.track import Run

    memory = memory_bytes(max_memory)
    checked = find_errors(
        predictions_here(predictions),
        data=resolve_data(data),
        protocol=protocol,
        run=Run(memory, limits=Limits(memory) if untrusted else None),
        read_by=ReadBy(reader, names, image_size),
    )
    for line in checked.described:
        if checked.errors:
            say(f"{predictions}: {line}")
        else:
            put(f"{predictions}: {line}\n")
    for error in checked.errors:
        say(str(error))
    for note in checked.notes:
        say(f"{predictions}: {note}")
    if checked.errors:
        raise typer.Exit(1)
    found = "nothing that eval refuses was found; see the notes" if checked.notes else ""
    put(f"{predictions}: {found or 'nothing wrong was found'}\n")


def template(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="The .npz to write (default: template.npz); for reconstruction the folder "
            "(default: template).",
        ),
    ] = None,
    kind: Annotated[
        Kind | None, typer.Option(help="Content of a retrieval file (default: ranked-ids).")
    ] = None,
    data: DataOption = None,
) -> None:
    """Write an example prediction: every query, with random tiles, matches or depth maps."""
    from airzoo_bench.evaluation.evaluate import write_template

    folder = resolve_data(data)
    written = write_template(protocol, data=folder, out=out, kind=kind and kind.value)
    say(f"wrote {written.out}: replace its arrays, which are random, by your own")
    if written.note is not None:
        say(written.note)
    command = "check" if written.sealed else f"eval {written.track}"
    say(f"next: airzoo-bench {command} {written.out}{with_data(data)}")


def readers(
    name: Annotated[str | None, typer.Argument(help="Describe this reader.")] = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """List the readers of methods' own files, or describe one."""
    from airzoo_bench.core.registry import READERS
    from airzoo_bench.evaluation.reader import reader_named

    if name is not None:
        one = reader_named(name)
        put(f"{one.title}, predictions of the {one.track} track\n")
        put(f"written by: {', '.join(one.methods)}\n" * bool(one.methods))
        put(f"recognised by: {one.layout}\n")
        return
    titles = ("Reader", "Track", "Reads", "Written by", "Recognised by")
    rows = []
    for key in READERS.names():
        one = READERS.get(key)
        rows.append((key, one.track, one.title, ", ".join(one.methods), one.layout))
    few = 3 if form is Format.TERMINAL else None
    show_rows("Readers", titles[:few], [row[:few] for row in rows], form)
