"""``airzoo-bench template``: an example prediction file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import DataOption, resolve_data, say, with_data

__all__ = ["template"]


class Kind(StrEnum):
    """What a prediction file holds."""

    RANKED_IDS = "ranked-ids"
    DESCRIPTORS = "descriptors"


def template(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The .npz to write.")] = Path(
        "template.npz"
    ),
    kind: Annotated[Kind, typer.Option(help="What the file shall hold.")] = Kind.RANKED_IDS,
    data: DataOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the random ranking.")] = 0,
) -> None:
    """Write an example prediction file: every query, with random tiles or matches.

    Example: airzoo-bench template uav-visloc-retrieval --out preds.npz
    """
    from airzoo_bench.runner.templates import write_template

    track = write_template(
        protocol,
        data=resolve_data(data),
        out=out,
        descriptors=kind is Kind.DESCRIPTORS,
        seed=seed,
    )
    say(f"wrote {out}: replace its arrays by your own")
    say(f"next: airzoo-bench eval {track} {out}{with_data(data)}")
