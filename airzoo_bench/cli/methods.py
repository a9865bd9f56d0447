"""``airzoo-bench readers``, ``template``, ``baseline``, ``demo``: predictions of methods."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import READERS, TRACKS, resolve
from airzoo_bench.engines.engine import LOCAL, open_engine

_DEMO = "airzoo-demo"
_BASELINES = {
    name: one for name in TRACKS.names() if (one := TRACKS.get(name).baseline) is not None
}
_summaries = " ".join(f"{name}: {one.summary}" for name, one in _BASELINES.items())


def readers(
    name: Annotated[cli.Text, typer.Argument(help="Describe this reader.")] = None,
    form: cli.FormatOption = cli.Format.TERMINAL,
) -> None:
    """List the readers of methods' own files, or describe one.

    Example: airzoo-bench readers vpr

    Example: airzoo-bench eval retrieval logs/2026-01-01_12-00-00 --protocol uav-visloc-retrieval
    """
    from airzoo_bench.evaluation.predictions import reader_named

    if name is not None:
        one = reader_named(name)
        cli.echo(f"{one.title}, predictions of the {one.track} track\n")
        cli.echo(f"written by: {', '.join(one.methods)}\n" * bool(one.methods))
        cli.echo(f"recognised by: {one.layout}\n")
        cli.echo("".join(f"taken to be so: {convention}\n" for convention in one.conventions))
        return
    titles = ("Reader", "Track", "Reads", "Written by", "Recognised by")
    found = READERS.load_all().items()
    rows = [(k, r.track, r.title, ", ".join(r.methods), r.layout) for k, r in found]
    few = 3 if form is cli.Format.TERMINAL else None
    cli.show_rows("Readers", titles[:few], [row[:few] for row in rows], form)


def template(
    protocol: Annotated[str, typer.Argument(help="Name or .toml file.")],
    out: Annotated[
        cli.File,
        cli.option("The .npz or, for reconstruction, the folder to write.", "--out", "-o"),
    ] = None,
    kind: Annotated[
        Literal["ranked-ids", "descriptors"] | None,
        cli.option("Content of a retrieval file (default: ranked-ids)."),
    ] = None,
    data: cli.DataOption = None,
) -> None:
    """Write an example prediction: every query, with random tiles, matches or depth maps.

    Example: airzoo-bench template airzoo-mini-retrieval --out preds.npz
    """
    from airzoo_bench.evaluation.evaluate import write_template

    path, track = write_template(protocol, data=cli.resolve_data(data), out=out, kind=kind)
    cli.say(f"wrote {path}: replace its arrays, which are random, by your own")
    cli.say(f"next: airzoo-bench check {path}{cli.with_data(data)}")
    if track is not None:
        cli.say(f"then: airzoo-bench eval {track} {path}{cli.with_data(data)} --out results/mine")


def baseline(
    track: Annotated[str, typer.Argument(metavar="TRACK", help=_summaries)],
    protocol: Annotated[
        cli.Text, typer.Argument(metavar="PROTOCOL", help="Name or .toml file.")
    ] = None,
    out: Annotated[
        cli.File, cli.option("The .npz, or for reconstruction the folder, to write.", "--out", "-o")
    ] = None,
    data: cli.DataOption = None,
    features: Annotated[
        int | None, cli.option("Most SIFT features of a photo (default: the track's).", min=100)
    ] = None,
    long_side: Annotated[
        int | None, cli.option("Largest side of a photo, px (default: the track's).", min=64)
    ] = None,
    double: Annotated[
        bool, cli.option("Find the finest features too, which takes four times as long.")
    ] = True,
    jobs: cli.JobsOption = None,
    engine: cli.EngineOption = LOCAL,
) -> None:
    """Run a plain method that needs no weights.

    Example: airzoo-bench baseline retrieval brighton-retrieval --out sift.npz

    Example: airzoo-bench baseline matching brighton-matching --out matches.npz
    """
    from airzoo_bench.evaluation.evaluate import run_baseline
    from airzoo_bench.evaluation.track import Run

    cli.check_choice("airzoo-bench baseline", track, list(_BASELINES))
    if protocol is None:
        raise UsageError("no protocol is named", fix="`airzoo-bench protocols` lists them")
    plain, jobs = _BASELINES[track], jobs or 2
    asked = {"max_features": features, "long_side_px": long_side, "doubled": double}
    changes = {k: v for k, v in asked.items() if v is not None and k in vars(plain.settings)}
    path = out or Path(plain.out)
    with open_engine(engine, jobs=jobs, processes=jobs) as place:
        run_baseline(
            track,
            protocol,
            path,
            data=cli.resolve_data(data),
            settings=replace(plain.settings, **changes),
            run=Run(jobs=jobs, progress=cli.progress, engine=place),
            note=cli.say,
        )
    score = f"airzoo-bench eval {track} {path}{cli.with_data(data)} --out results/{path.stem}"
    cli.say(f"wrote {path}\nnext: {score}")


def demo(
    out: Annotated[Path, cli.option("Folder for predictions and results.", "--out", "-o")] = Path(
        _DEMO
    ),
) -> None:
    """Run a plain method on every track of a small benchmark, and print the tables.

    Needs no data: the benchmark is part of the package. Predictions of an earlier run are reused.

    Example: airzoo-bench demo
    """
    from airzoo_bench.benchmark.folder import find_benchmark
    from airzoo_bench.core.files import check_output_folder, data_root
    from airzoo_bench.evaluation.evaluate import evaluate, run_baseline, save
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.tables.layouts import scenes_table

    check_output_folder(out, ())
    benchmark = find_benchmark(_DEMO, data_root())
    data, run = benchmark.folder, Run(jobs=2, progress=cli.progress, keep=True)
    cli.say(f"{_DEMO}: photos of a made-up city, in {data}")
    for name in benchmark.file.tracks:
        plain = _BASELINES[name]
        cli.say(f"{name}: {plain.method}")
        path = out / name / plain.out
        if not path.exists():
            protocol = f"{_DEMO}-{name}"
            run_baseline(name, protocol, path, data=data, settings=plain.demo, run=run)
        scored = evaluate(path, data=data, track=name, method=plain.method, run=run)
        figures = TRACKS.get(name).figures
        save(scored, out / name, partial(resolve(figures), scored, run) if figures else None)
        cli.show(scenes_table(scored.result, floors=True), cli.Format.TERMINAL)
        cli.echo("\n")
    cli.say(f"predictions, result.json and records.csv of each track lie in {out}")
    cli.say(f"next: airzoo-bench report {out}/* --out demo.html")
    cli.say(f"      put your own method next to it: airzoo-bench template {_DEMO}-retrieval")
