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
    kind: Annotated[Kind, typer.Option(help="What the file shall hold.")] = Kind.RANKED_IDS,
    data: DataOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of what is random.")] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Write over a file that is there.")
    ] = False,
) -> None:
    """Write an example prediction: every query, with random tiles, matches or depth maps.

    Example: airzoo-bench template uav-visloc-retrieval --out preds.npz
    """
    from airzoo_bench.evaluation.template import write_template
    from airzoo_bench.protocol.lookup import RetrievalProtocol, find_protocol

    root = resolve_data(data)
    chosen = find_protocol(protocol, root)
    track = chosen.track
    target = out or Path("template" if track == "reconstruction" else "template.npz")
    write_template(
        protocol,
        data=root,
        out=target,
        descriptors=kind is Kind.DESCRIPTORS,
        seed=seed,
        force=force,
    )
    say(f"wrote {target}: replace its arrays, which are random, by your own")
    if isinstance(chosen, RetrievalProtocol):
        from airzoo_bench.retrieval.track import chance_words

        say(f"random tiles score by chance: {chance_words(chosen, root)}")
    say(f"next: airzoo-bench eval {track} {target}{with_data(data)}")
