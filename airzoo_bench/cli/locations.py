"""Options and arguments that are paths or URLs, and what lies there as a path of this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import working
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import data_location, data_root
from airzoo_bench.storage.urls import is_url, local_path

DataOption = Annotated[
    str | None,
    typer.Option(
        "--data",
        metavar="PATH|URL",
        help="The benchmark folder, the folder that holds it, or the URL of either, such as "
        "s3://bucket/name (default: $AIRZOO_BENCH_DATA, else a cache folder).",
    ),
]
ResultsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="RESULTS", help="One or more result.json, or their folders: paths or URLs."
    ),
]


def resolve_data(data: str | None) -> Path:
    """Return the folder named, else the configured data root; what lies at a URL is copied."""
    if is_url(data_location() if data is None else data):
        from airzoo_bench.benchmark.folder import data_here

        with working("fetching the benchmark"):
            return data_here(data)
    if data is not None and not Path(data).is_dir():
        raise UsageError(
            "no such folder",
            where=f"--data {data}",
            expected="a benchmark folder, or the folder that holds some",
            fix="make one with `airzoo-bench prepare`",
        )
    return data_root() if data is None else Path(data)


def predictions_here(location: str) -> Path:
    """Return predictions as a path of this machine; what lies at a URL is copied."""
    if not is_url(location):
        return Path(location)
    with working("fetching the predictions"):
        return local_path(location)


def with_data(data: str | Path | None) -> str:
    """Return the ``--data`` option for the command that is suggested next."""
    return "" if data is None else f" --data {data}"
