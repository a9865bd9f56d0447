"""``airzoo-bench baseline`` and ``demo``: predictions of plain methods that need no weights."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import (
    BuiltGroup,
    Command,
    built_app,
    engine_parameters,
    option_parameters,
    parameter,
    with_parameters,
)
from airzoo_bench.cli.common import Format, progress, put, say, show
from airzoo_bench.cli.locations import DataOption, resolve_data, with_data
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.engines.engine import Processes, open_engine

if TYPE_CHECKING:
    from airzoo_bench.evaluation.info import TrackInfo

_DEMO = "airzoo-demo"


class _BaselineGroup(BuiltGroup):
    registry = TRACKS
    own_panel = "Method"
    panels: ClassVar[dict[str, tuple[str, ...]]] = {"Benchmark and predictions": ("data", "out")}

    def list_commands(self, ctx: Any) -> list[str]:
        return [name for name in TRACKS.names() if TRACKS.get(name).baseline is not None]

    def summary_of(self, name: str) -> str:
        return str(TRACKS.get(name).baseline.summary)

    def command_of(self, thing: TrackInfo) -> tuple[Command, str]:
        baseline: Any = thing.baseline
        out = Annotated[Path, typer.Option("--out", "-o", help=baseline.out_help)]
        parameters = [
            parameter("protocol", Annotated[str, typer.Argument(help="Name or .toml file.")]),
            parameter("out", out, Path(baseline.out)),
            parameter("data", DataOption, None),
            *option_parameters(type(baseline.settings)),
            *engine_parameters(2),
        ]
        command = with_parameters(partial(_predict, thing), parameters, baseline.summary)
        return command, f"baseline {thing.name} {baseline.example}"


app = built_app(_BaselineGroup, "Run a plain method that needs no weights.")


def _predict(
    track: TrackInfo,
    protocol: str,
    out: Path,
    data: str | None,
    jobs: int,
    engine: str,
    **settings: Any,
) -> None:
    from airzoo_bench.evaluation.evaluate import run_baseline
    from airzoo_bench.evaluation.track import Run

    baseline: Any = track.baseline
    with open_engine(engine, jobs=jobs, here=Processes(jobs)) as place:
        run_baseline(
            track.name,
            protocol,
            out,
            data=resolve_data(data),
            settings=replace(baseline.settings, **settings),
            run=Run(jobs=jobs, progress=progress, engine=place),
            note=say,
        )
    say(f"wrote {out}")
    say(f"next: airzoo-bench eval {track.name} {out}{with_data(data)}")


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for predictions and results.")
    ] = Path("airzoo-demo"),
) -> None:
    """Run a plain method on every track of a small benchmark, and print the tables.

    Needs no data: the benchmark is part of the package. Predictions of an earlier run are reused.
    """
    from airzoo_bench.benchmark.folder import find_benchmark
    from airzoo_bench.core.files import check_output_folder, data_root
    from airzoo_bench.evaluation.evaluate import evaluate, run_baseline
    from airzoo_bench.evaluation.run_files import save
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.tables.layouts import scenes_table

    check_output_folder(out, ())
    benchmark = find_benchmark(_DEMO, data_root())
    data = benchmark.folder
    say(f"{_DEMO}: photos of a made-up city, in {data}")
    run = Run(jobs=2, progress=progress)
    for name in benchmark.file.tracks:
        if (baseline := TRACKS.get(name).baseline) is None:
            continue
        say(f"{name}: {baseline.method}")
        path = out / name / baseline.out
        if not path.exists():
            protocol = f"{_DEMO}-{name}"
            run_baseline(name, protocol, path, data=data, settings=baseline.demo, run=run)
        scored = evaluate(path, data=data, track=name, method=baseline.method, run=run)
        save(scored, out / name)
        show(scenes_table(scored.result, floors=True), Format.TERMINAL)
        put("\n")
    say(f"predictions, result.json and records.csv of each track lie in {out}")
    say(f"next: airzoo-bench report {out / 'retrieval'} {out / 'matching'} --out demo.html")
    say(f"      put your own method next to it: airzoo-bench template {_DEMO}-retrieval")
