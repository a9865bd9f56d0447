"""``airzoo-bench sensitivity``: how scores move when values that the truth assumes are off."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import (
    Format,
    FormatOption,
    check_output,
    examples,
    progress,
    say,
    show,
)
from airzoo_bench.cli.locations import DataOption, resolve_data
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.datasets.about import About
    from airzoo_bench.results.records import Scored
    from airzoo_bench.results.sensitivity import NoiseFloor, Sensitivity
    from airzoo_bench.retrieval.assumptions import AssumedRanges
    from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["EXAMPLES", "PANELS", "sensitivity"]

EXAMPLES = examples(
    "sensitivity uav-visloc results/*/result.json --out noise-floor.json",
    "sensitivity park results/* --heading 5 --height 10 --position 3",
    "compare results/*/result.json --noise-floor noise-floor.json",
)

PANELS = {
    "How far assumed values may be off": ("field_of_view", "heading", "height", "position"),
    "Draws": ("draws", "seed"),
    "Output": ("score", "out", "form"),
}


def sensitivity(
    benchmark: Annotated[str, typer.Argument(help="A benchmark folder's name in the data root.")],
    results: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULTS", help="Results on it: result.json, or their folders; paths or URLs."
        ),
    ],
    field_of_view: Annotated[
        float | None, typer.Option(min=0, max=0.9, help="Share of the angle, either way.")
    ] = None,
    heading: Annotated[
        float | None, typer.Option(min=0, max=180, help="Degrees, either way, of all photos.")
    ] = None,
    height: Annotated[
        float | None, typer.Option(min=0, help="Metres, either way, of all photos.")
    ] = None,
    position: Annotated[
        float | None,
        typer.Option(min=0, help="Metres: standard deviation of each photo's position."),
    ] = None,
    draws: Annotated[
        int, typer.Option(min=1, max=10_000, help="Of positions, and of all values at once.")
    ] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of the draws.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write noise floors, for compare and table."),
    ] = None,
    score: Annotated[
        list[str] | None, typer.Option(help="Print this score only; repeatable.")
    ] = None,
    data: DataOption = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """Make the truth again with assumed values that are off; print how scores and ranks move.

    Ranges that are not given are those that the benchmark states. A difference between two methods
    that is no larger than the noise floor could be otherwise if the assumed values were.
    """
    from airzoo_bench.benchmark.folder import find_benchmark
    from airzoo_bench.results.comparable import check_same_queries
    from airzoo_bench.results.files import results_here
    from airzoo_bench.results.records import read_scored
    from airzoo_bench.results.selection import check_score
    from airzoo_bench.results.sensitivity import write_noise_floor
    from airzoo_bench.retrieval.assumptions import AssumedRanges
    from airzoo_bench.retrieval.sensitivity import sensitivity as measured
    from airzoo_bench.tables.sensitivity_layout import sensitivity_table

    paths = results_here(results)
    if out is not None:
        check_output(out, paths)
    methods = read_scored(paths)
    check_same_queries(methods)
    if out is not None and len(methods) < 2:
        raise UsageError(
            "noise floors are of differences, and there is one result",
            where=f"--out {out}",
            fix="name two or more results",
        )
    found = find_benchmark(benchmark, resolve_data(data))
    given = {
        "field_of_view": field_of_view,
        "heading_deg": heading,
        "height_m": height,
        "position_m": position,
    }
    about = _about(found.name)
    stated = {} if about is None else about.ranges
    ranges = AssumedRanges(
        **{name: stated.get(name, 0.0) if value is None else value for name, value in given.items()}
    )
    protocol = _protocol_of(methods, found, data)
    with found.fixes():
        moved = measured(
            found, protocol, methods, ranges, draws=draws, seed=seed, progress=progress
        )
    for name in score or ():
        check_score(name, moved.scores, "--score")
    chosen = [one for one in moved.scores if not score or {one.key, one.title} & set(score)]
    without = () if about is None else about.without_range
    show(sensitivity_table(moved, ranges.given, chosen, without), form)
    if out is not None:
        write_noise_floor(out, _floor(moved, methods, ranges, draws, seed))
        say(f"{out}: for `airzoo-bench compare` and `table`, --noise-floor {out}")


def _about(name: str) -> About | None:
    """Return what is known of a published benchmark, or of a part of it."""
    from airzoo_bench.core.registry import DATASETS

    whole = name.removesuffix("-partial")
    return getattr(DATASETS.get(whole), "about", None) if whole in DATASETS.names() else None


def _protocol_of(
    methods: Sequence[Scored], benchmark: Benchmark, data: str | None
) -> RetrievalProtocol:
    from airzoo_bench.protocol.lookup import find_protocol
    from airzoo_bench.retrieval.settings import RetrievalProtocol

    used = methods[0].result.protocol
    protocol = find_protocol(used.name, resolve_data(data))
    if not isinstance(protocol, RetrievalProtocol):
        raise UsageError(
            f"{methods[0].name} is a result of the {protocol.track} track",
            expected="results of retrieval, whose truth follows from poses and tiles",
        )
    if protocol.fingerprint != used.fingerprint:
        raise UsageError(
            f"{methods[0].name} was scored by another {used.name} than is here",
            expected=f"protocol {protocol.fingerprint[:12]}, not {used.fingerprint[:12]}",
            fix="score the predictions again",
        )
    benchmark.check_fits(protocol)
    return protocol


def _floor(
    moved: Sensitivity, methods: Sequence[Scored], ranges: AssumedRanges, draws: int, seed: int
) -> NoiseFloor:
    from airzoo_bench.results.sensitivity import NoiseFloor

    result = methods[0].result
    keys = [score.key for score in moved.scores]
    return NoiseFloor(
        protocol=result.protocol.name,
        protocol_fingerprint=result.protocol.fingerprint,
        truth_fingerprint=result.truth.fingerprint,
        ranges=ranges.given,
        draws=draws,
        seed=seed,
        methods={one.name: one.result.predictions.sha256 for one in methods},
        overall=dict(zip(keys, moved.floors().tolist(), strict=True)),
        scenes={
            scene: dict(zip(keys, moved.floors(scene).tolist(), strict=True))
            for scene in moved.scenes
        },
    )
