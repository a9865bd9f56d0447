"""``airzoo-bench baseline``: predictions of plain methods that need no weights."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    DataOption,
    JobsOption,
    progress,
    resolve_data,
    say,
    with_data,
)

__all__ = ["app"]

_PEAK_THRESHOLD = 0.02 / 3  # pycolmap's own

DoubleOption = Annotated[
    bool,
    typer.Option(
        "--double/--no-double", help="Look for the finest features too, for four times the time."
    ),
]

app = typer.Typer(help="Run a plain method that needs no weights.", no_args_is_help=True)


@app.callback()
def _group() -> None:
    """Run a plain method that needs no weights."""


@app.command(epilog="Example: airzoo-bench baseline retrieval brighton-retrieval --out sift.npz")
def retrieval(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The .npz to write.")] = Path(
        "sift-vlad.npz"
    ),
    data: DataOption = None,
    words: Annotated[int, typer.Option(min=2, max=4096, help="Visual words.")] = 64,
    long_side: Annotated[int, typer.Option(min=64, help="Photos are made this small, px.")] = 1024,
    seed: Annotated[int, typer.Option(min=0, help="Of sampling and k-means.")] = 0,
    double: DoubleOption = True,
    jobs: JobsOption = 2,
) -> None:
    """Describe photos and tiles by SIFT and VLAD, and write a prediction file."""
    from airzoo_bench.baselines import retrieval_baseline
    from airzoo_bench.retrieval.baseline import VladSettings

    retrieval_baseline(
        protocol,
        out,
        data=resolve_data(data),
        settings=VladSettings(words=words, seed=seed, doubled=double),
        long_side_px=long_side,
        jobs=jobs,
        progress=progress,
    )
    say(f"wrote {out}")
    say(f"next: airzoo-bench eval retrieval {out}{with_data(data)}")


@app.command(epilog="Example: airzoo-bench baseline matching brighton-matching --out matches.npz")
def matching(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The .npz to write.")] = Path(
        "sift-matches.npz"
    ),
    data: DataOption = None,
    features: Annotated[int, typer.Option(min=4, help="SIFT features of a photo.")] = 8192,
    map_features: Annotated[int, typer.Option(min=4, help="SIFT features of a crop.")] = 16384,
    ratio: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Of the nearest to the second distance.")
    ] = 0.8,
    long_side: Annotated[
        int, typer.Option(min=64, help="Pictures are made this small, px.")
    ] = 2000,
    double: DoubleOption = True,
    jobs: JobsOption = 2,
) -> None:
    """Match photos to their crops by SIFT, mutual neighbours and ratio test."""
    from airzoo_bench.baselines import matching_baseline
    from airzoo_bench.matching.baseline import SiftSettings

    matching_baseline(
        protocol,
        out,
        data=resolve_data(data),
        settings=SiftSettings(
            max_features=features,
            max_map_features=map_features,
            peak_threshold=_PEAK_THRESHOLD,
            ratio=ratio,
            max_side_px=long_side,
            doubled=double,
        ),
        jobs=jobs,
        progress=progress,
    )
    say(f"wrote {out}")
    say(f"next: airzoo-bench eval matching {out}{with_data(data)}")


@app.command(
    epilog="Example: airzoo-bench baseline reconstruction airzoo-mini-reconstruction --out sfm"
)
def reconstruction(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path("sfm"),
    data: DataOption = None,
    features: Annotated[int, typer.Option(min=100, help="SIFT features of a photo.")] = 4096,
    neighbours: Annotated[
        int, typer.Option(min=2, help="Each photo is matched with so many, by GPS.")
    ] = 12,
    long_side: Annotated[int, typer.Option(min=64, help="Photos are made this small, px.")] = 1600,
    seed: Annotated[int, typer.Option(min=0, help="Of every random choice.")] = 0,
    double: DoubleOption = True,
    jobs: JobsOption = 2,
) -> None:
    """Reconstruct scenes by structure from motion (pycolmap): a sparse cloud and cameras.

    A run that was stopped goes on.
    """
    from airzoo_bench.baselines import reconstruction_baseline
    from airzoo_bench.reconstruction.baseline import SfmSettings

    reconstruction_baseline(
        protocol,
        out,
        data=resolve_data(data),
        settings=SfmSettings(
            long_side_px=long_side,
            max_features=features,
            peak_threshold=_PEAK_THRESHOLD,
            doubled=double,
            ratio=0.8,
            neighbours=neighbours,
            least_inliers=15,
            max_error_px=4.0,
            seed=seed,
        ),
        jobs=jobs,
        progress=progress,
        note=say,
    )
    say(f"wrote {out}")
    say(f"next: airzoo-bench eval reconstruction {out}{with_data(data)}")
