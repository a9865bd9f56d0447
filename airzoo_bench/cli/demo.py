"""``airzoo-bench demo``: a plain method on every track of the small benchmark that is shipped."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, JobsOption, examples, progress, put, say, show

if TYPE_CHECKING:
    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.evaluation.info import Baseline, TrackInfo
    from airzoo_bench.evaluation.track import Run


EXAMPLES = examples("demo")
_NAME = "airzoo-demo"


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Where predictions and results go.")
    ] = Path("airzoo-demo"),
    jobs: JobsOption = 2,
) -> None:
    """Run a plain method on every track of a small benchmark, and print the tables.

    Needs no data: the benchmark is shipped. Predictions of an earlier run are used again.
    """
    from airzoo_bench.benchmark.folder import find_benchmark
    from airzoo_bench.core.files import check_output_folder, data_root
    from airzoo_bench.core.registry import TRACKS
    from airzoo_bench.evaluation.evaluate import evaluate
    from airzoo_bench.evaluation.run_files import save
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.tables.layouts import scenes_table

    check_output_folder(out, ())
    benchmark = find_benchmark(_NAME, data_root())
    data = benchmark.folder
    say(f"{_NAME}: photos of a made-up city, in {data}")
    run = Run(jobs=jobs, progress=progress)
    for name in benchmark.file.tracks:
        track = TRACKS.get(name)
        if (baseline := track.baseline) is None:
            continue
        say(f"{name}: {baseline.method}")
        predictions = _predictions(track, baseline, benchmark, out / name, run)
        scored = evaluate(predictions, data=data, track=name, method=baseline.method, run=run)
        save(scored, out / name)
        show(scenes_table(scored.result, floors=True), Format.TERMINAL)
        put("\n")
    say(f"predictions, result.json and records.csv of each track lie in {out}")
    say(f"next: airzoo-bench report {out / 'retrieval'} {out / 'matching'} --out demo.html")
    say(f"      put your own method next to it: airzoo-bench template {_NAME}-retrieval")


def _predictions(
    track: TrackInfo,
    baseline: Baseline,
    benchmark: Benchmark,
    folder: Path,
    run: Run,
) -> Path:
    """Return the file of the plain method, made now unless this version has made it already."""
    from airzoo_bench.core.files import atomic_write, fingerprint
    from airzoo_bench.core.version import __version__
    from airzoo_bench.evaluation.evaluate import run_baseline

    path, mark = folder / baseline.out, folder / ".made-from"
    made_from = fingerprint([__version__, benchmark.file.checksums])
    if not (path.exists() and mark.is_file() and mark.read_text() == made_from):
        mark.unlink(missing_ok=True)
        run_baseline(
            track.name,
            f"{_NAME}-{track.name}",
            path,
            data=benchmark.folder,
            settings=baseline.demo,
            run=run,
        )
        with atomic_write(mark, "w") as stream:
            stream.write(made_from)
    return path
