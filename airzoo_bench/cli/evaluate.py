"""``airzoo-bench eval`` and ``check``: score predictions, or find their errors."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Annotated

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.engines.engine import LOCAL, open_engine

_INFOS = {name: TRACKS.get(name) for name in TRACKS.names()}
_summaries = " ".join(f"{name}: {info.summary}" for name, info in _INFOS.items())
_files = " ".join(f"{name}: {info.argument}" for name, info in _INFOS.items())


def evaluate(
    track: Annotated[str, typer.Argument(metavar="TRACK", help=_summaries)],
    predictions: Annotated[
        cli.Text, typer.Argument(metavar="PREDICTIONS", help=f"A path or URL. {_files}")
    ] = None,
    protocol: cli.ProtocolOption = None,
    data: cli.DataOption = None,
    reader: cli.ReaderOption = None,
    names: cli.NamesOption = None,
    image_size: cli.ImageSizeOption = None,
    out: Annotated[
        cli.File,
        cli.option("Folder for result.json and records.csv.", "--out", "-o", panel="Output"),
    ] = None,
    method: Annotated[
        cli.Text, cli.option("Its name in tables (default: that of --out).", panel="Output")
    ] = None,
    form: cli.FormatOption = cli.Format.TERMINAL,
    figures: Annotated[
        bool,
        cli.option("Draw maps or clouds into --out, for report too.", "--figures", panel="Output"),
    ] = False,
    jobs: cli.JobsOption = None,
    engine: cli.EngineOption = LOCAL,
    max_memory: cli.MemoryOption = "2G",
    untrusted: cli.UntrustedOption = False,
    resume: Annotated[
        bool,
        cli.option("Keep scored scenes, and continue from them.", "--resume", panel="For scale"),
    ] = False,
) -> None:
    """Score predictions and print the per-scene table.

    Example: airzoo-bench eval retrieval preds.npz --out results/mymethod

    Example: airzoo-bench eval reconstruction clouds --out results/myreconstruction --figures
    """
    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.evaluate import check_run_folder, save
    from airzoo_bench.evaluation.evaluate import evaluate as score
    from airzoo_bench.evaluation.predictions import ReadRequest
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.results.result import read_result
    from airzoo_bench.tables.layouts import scenes_table

    cli.check_choice("airzoo-bench eval", track, TRACKS.names())
    if predictions is None:
        raise UsageError("there is nothing to score", fix=f"airzoo-bench eval {track} PREDICTIONS")
    info = TRACKS.get(track)
    if figures and not info.figures:
        raise UsageError(f"--figures: the {track} track does not draw any")
    if out is None and (figures or resume):
        raise UsageError("--figures and --resume write into a folder", fix="add --out DIR")
    verb = "replaced" if out and (out / "result.json").exists() else "wrote"
    if out is not None:
        check_run_folder(out, predictions)
        with suppress(ResultError):  # it is of an older version
            if verb == "replaced" and (earlier := read_result(out / "result.json")).track != track:
                what = f"holds a result of {earlier.protocol.name}"
                raise UsageError(what, where=out, fix="name another --out")
        method = method or out.resolve().name or None
    memory, jobs, unfinished = cli.memory_bytes(max_memory), jobs or info.jobs, None
    if out is not None and resume and not figures:
        unfinished = out.resolve().with_name(f"{out.resolve().name}.unfinished")
    with open_engine(engine, jobs=jobs) as place:
        place.progress = cli.progress
        threads = jobs if engine == LOCAL else 1
        run = Run(
            memory, threads, cli.progress, figures, place, Limits(memory) if untrusted else None
        )
        evaluation = score(
            cli.predictions_here(predictions),
            data=cli.resolve_data(data),
            track=track,
            protocol=protocol,
            method=method,
            run=run,
            request=ReadRequest(reader, names, image_size),
            unfinished=unfinished,
        )
        if evaluation.opened.reader is not None:
            cli.say(f"read by reader {evaluation.opened.reader} (see `airzoo-bench check`)")
        draw = partial(resolve(info.figures), evaluation, run) if figures else None
        written = [] if out is None else save(evaluation, out, draw)
    if form is cli.Format.JSON:
        cli.echo(evaluation.result.model_dump_json(by_alias=True, indent=1) + "\n", form)
    else:
        cli.show(scenes_table(evaluation.result, floors=True), form)
    about = "airzoo_bench.reconstruction.track:describe_alignments"  # slow to import
    said = resolve(about)(evaluation) if track == "reconstruction" else []
    if out is None:
        said.append("nothing was written; add --out DIR to keep the result and its records")
    else:
        said.append(f"{verb} {', '.join(map(str, written))} of method {method}")
        said.append(f"next: airzoo-bench report {out}, or airzoo-bench table {out} --format latex")
    cli.say("\n".join(said))


def check(
    predictions: Annotated[
        str,
        typer.Argument(metavar="PREDICTIONS", help="File, folder or archive: a path or URL."),
    ],
    protocol: cli.ProtocolOption = None,
    data: cli.DataOption = None,
    reader: cli.ReaderOption = None,
    names: cli.NamesOption = None,
    image_size: cli.ImageSizeOption = None,
    max_memory: cli.MemoryOption = "2G",
    untrusted: cli.UntrustedOption = False,
) -> None:
    """Find errors in predictions, name their reader and how many queries they answer.

    Exit code 0: eval would take them; 1: it would refuse them; 2: there is nothing to check, as
    with no file or an unknown protocol.

    Needs the benchmark folder, whose truth may be sealed, and finds whatever eval would refuse: in
    each file or scene, the first error.

    Example: airzoo-bench check preds.npz

    Example: airzoo-bench check logs/2026-01-01_12-00-00 --protocol airzoo-mini-retrieval
    """
    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.evaluate import check as find_errors
    from airzoo_bench.evaluation.predictions import ReadRequest
    from airzoo_bench.evaluation.track import Run

    memory = cli.memory_bytes(max_memory)
    checked = find_errors(
        cli.predictions_here(predictions),
        data=cli.resolve_data(data),
        protocol=protocol,
        run=Run(memory, limits=Limits(memory) if untrusted else None),
        request=ReadRequest(reader, names, image_size),
    )
    write = cli.say if checked.errors else lambda text: cli.echo(f"{text}\n")
    for line in checked.described:
        write(f"{predictions}: {line}")
    for line in (*map(str, checked.errors), *(f"{predictions}: {one}" for one in checked.notes)):
        cli.say(line)
    if checked.errors:
        raise typer.Exit(1)
    found = "nothing that eval refuses was found; see the notes" if checked.notes else ""
    cli.echo(f"{predictions}: {found or 'nothing wrong was found'}\n")
