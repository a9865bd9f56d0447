"""``airzoo-bench demo``: every track on AirZoo-Mini, from nothing to tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, JobsOption, examples, progress, put, say, show

__all__ = ["EXAMPLES", "demo"]

EXAMPLES = examples("demo")


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Where predictions and results go.")
    ] = Path("airzoo-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another place.")] = 0,
    jobs: JobsOption = 2,
) -> None:
    """Make a world, run a plain method on every track, and print the tables. Needs no data.

    The world and its photos are kept in the data root. A run that was stopped goes on.
    """
    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.core.places import check_output_folder, data_root
    from airzoo_bench.datasets.mini.demo import demo_benchmark, demo_tracks, run_track
    from airzoo_bench.engines.processes import Processes
    from airzoo_bench.evaluation.parts import Resources
    from airzoo_bench.tables.layouts import scenes_table

    check_output_folder(out, ())
    say(f"AirZoo-Mini: a made-up city and a valley, kept in {data_root()}")
    data = demo_benchmark(
        data_root(), seed=seed, engine=Processes(jobs), progress=progress, note=say
    )
    resources = Resources(jobs=jobs, progress=progress)
    for track, baseline in demo_tracks():
        say(f"{track.name}: {baseline.method}")
        result = run_track(track, baseline, data, out, seed=seed, resources=resources)
        show(scenes_table(result, floors=True), Format.TERMINAL)
        put("\n")
    say(f"predictions, result.json and records.csv of each track lie in {out}")
    benchmark = Benchmark.open(data)
    first = out / demo_tracks()[0][0].name
    say(f"next: airzoo-bench table {first / 'result.json'} --format latex")
    photos = [str(benchmark.resolve(scene.images)) for scene in benchmark.file.scenes]
    say(f"      look at the photos, which lie in {' and '.join(photos)}")
    say("      put your own method next to it: airzoo-bench template airzoo-mini-retrieval")
