"""``airzoo-bench eval``: score predictions."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import BuiltGroup, parameter, with_parameters
from airzoo_bench.cli.common import (
    DataOption,
    Format,
    FormatOption,
    JobsOption,
    MemoryOption,
    NamesOption,
    ProtocolOption,
    ReaderOption,
    memory_bytes,
    progress,
    put,
    resolve_data,
    say,
    show,
)
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS

if TYPE_CHECKING:
    from airzoo_bench.evaluation.given import AnyTrack
    from airzoo_bench.evaluation.parts import EvalOption
    from airzoo_bench.results.result import Result

__all__ = ["app"]

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", help="Folder for result.json and records.csv, in place of an earlier run's."
    ),
]
MethodOption = Annotated[
    str | None,
    typer.Option(help="The method's name in tables (default: the name of --out, else the file's)."),
]
AllOption = Annotated[bool, typer.Option("--all", help="Print every score, not the paper's only.")]


class _EvalGroup(BuiltGroup):
    registry = TRACKS
    own_panel = "Figures and checks"
    panels: ClassVar[dict[str, tuple[str, ...]]] = {
        "Predictions": ("protocol", "data", "reader", "names"),
        "Output": ("out", "method", "form", "every_score"),
        "Resources": ("jobs", "max_memory"),
    }

    def command_of(self, thing: AnyTrack) -> tuple[Callable[..., None], str]:
        parameters = [
            parameter("predictions", Annotated[Path, typer.Argument(help=thing.argument)]),
            parameter("protocol", ProtocolOption, None),
            parameter("data", DataOption, None),
            parameter("out", OutOption, None),
            parameter("reader", ReaderOption, None),
            parameter("names", NamesOption, None),
            parameter("method", MethodOption, None),
            parameter("form", FormatOption, Format.TERMINAL),
            parameter("every_score", AllOption, False),
            *(parameter(one.name, _kind(one), one.default) for one in thing.options),
            parameter("jobs", JobsOption, thing.jobs),
            parameter("max_memory", MemoryOption, "2G"),
        ]
        command = with_parameters(partial(_evaluate, thing), parameters, thing.summary)
        return command, f"eval {thing.name} {thing.example}"


app = typer.Typer(
    cls=_EvalGroup, help="Score predictions and print the per-scene table.", no_args_is_help=True
)


@app.callback()
def _group() -> None:
    """Score predictions and print the per-scene table."""


def _kind(one: EvalOption) -> Any:
    if isinstance(one.default, bool):
        return Annotated[bool, typer.Option(f"--{one.name}", help=one.help)]
    return Annotated[int, typer.Option(f"--{one.name}", min=1, max=one.most, help=one.help)]


def _evaluate(
    track: AnyTrack,
    predictions: Path,
    protocol: str | None,
    data: Path | None,
    out: Path | None,
    reader: str | None,
    names: Path | None,
    method: str | None,
    form: Format,
    every_score: bool,
    jobs: int,
    max_memory: str,
    **extras: bool | int,
) -> None:
    from airzoo_bench.core.registry import resolve
    from airzoo_bench.evaluation.evaluate import evaluate
    from airzoo_bench.evaluation.given import ReadBy
    from airzoo_bench.evaluation.parts import Resources
    from airzoo_bench.evaluation.run_files import save

    asked = [one for one in track.options if extras[one.name] != one.default]
    _refuse_without_folder(asked, out)
    name = _named_after(out, method)
    keep = any(one.needs_out for one in asked)
    resources = Resources(memory_bytes(max_memory), jobs, progress, keep)
    evaluation = evaluate(
        predictions,
        data=resolve_data(data),
        track=track.name,
        protocol=protocol,
        method=name,
        resources=resources,
        read_by=ReadBy(reader, names),
    )
    if evaluation.given.reader is not None:
        say(f"read by reader {evaluation.given.reader.name}: `airzoo-bench check` says how")
    written = [] if out is None else save(evaluation, out)

    def act(*, writing: bool) -> None:
        for one in asked:
            if one.needs_out == writing:
                for line in resolve(one.act)(evaluation, extras[one.name], out, resources):
                    say(line)

    act(writing=True)
    _print_result(evaluation.result, form, every_score=every_score)
    act(writing=False)
    if method is None and name is not None:
        say(f"the method is called {name}, after --out; --method gives it another name")
    _print_next(written)


def _refuse_without_folder(asked: list[EvalOption], out: Path | None) -> None:
    writing = [f"--{one.name}" for one in asked if one.needs_out]
    if writing and out is None:
        needs = "needs" if len(writing) == 1 else "need"
        raise UsageError(
            f"{' and '.join(writing)} {needs} a folder to write into", fix="add --out DIR"
        )


def _named_after(out: Path | None, method: str | None) -> str | None:
    """Check the output folder, and return the method's name: as given, or the folder's."""
    from airzoo_bench.evaluation.run_files import check_run_folder, earlier_run

    if out is None:
        return method
    check_run_folder(out)
    replaced = earlier_run(out)
    if replaced is not None:
        say(replaced)
    return method or out.resolve().name or None


def _print_result(result: Result, form: Format, *, every_score: bool) -> None:
    from airzoo_bench.tables.layouts import scenes_table

    if form is Format.JSON:
        content = json.loads(result.model_dump_json(by_alias=True))
        put(json.dumps(content, indent=1) + "\n")
    else:
        show(scenes_table(result, every_score=every_score, floors=True), form)


def _print_next(written: list[Path]) -> None:
    if written:
        *others, last = map(str, written)
        say(f"wrote {', '.join(others)} and {last}")
        say(f"next: airzoo-bench table {written[0]} --format latex")
    else:
        say("nothing was written; add --out DIR to keep the result and its records")
