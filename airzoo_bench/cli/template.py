"""``airzoo-bench template``: an example prediction file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import examples, say
from airzoo_bench.cli.locations import DataOption, resolve_data, with_data

EXAMPLES = examples("template airzoo-mini-retrieval --out preds.npz")


class Kind(StrEnum):
    """The content of a prediction file."""

    RANKED_IDS = "ranked-ids"
    DESCRIPTORS = "descriptors"


def template(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="The .npz to write (default: template.npz); for reconstruction the folder "
            "(default: template).",
            show_default=False,
        ),
    ] = None,
    kind: Annotated[
        Kind | None,
        typer.Option(help="Content of a retrieval file (default: ranked-ids)."),
    ] = None,
    data: DataOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Write over a file that is there.")
    ] = False,
) -> None:
    """Write an example prediction: every query, with random tiles, matches or depth maps."""
    from airzoo_bench.evaluation.evaluate import write_template

    folder = resolve_data(data)
    written = write_template(protocol, data=folder, out=out, kind=kind and kind.value, force=force)
    say(f"wrote {written.out}: replace its arrays, which are random, by your own")
    if written.note is not None:
        say(written.note)
    command = "check" if written.sealed else f"eval {written.track}"
    say(f"next: airzoo-bench {command} {written.out}{with_data(data)}")
