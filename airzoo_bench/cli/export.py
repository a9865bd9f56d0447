"""``airzoo-bench export``: benchmarks and results for other platforms."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import examples, put, say
from airzoo_bench.cli.locations import DataOption, resolve_data

if TYPE_CHECKING:
    from airzoo_bench.leaderboard.exports.bundle import Competition

__all__ = ["app"]

app = typer.Typer(
    help="Benchmarks and results for other platforms: Codabench, EvalAI, Hugging Face.",
    no_args_is_help=True,
)

ProtocolArgument = Annotated[str, typer.Argument(help="Name of the protocol, or its .toml file.")]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder to write into.")]
PhasesOption = Annotated[
    list[str],
    typer.Option(
        "--phase",
        help="NAME,START,END: when submissions are taken, from a day to before another (UTC). "
        "Give it again for a phase that follows.",
    ),
]
SealedOption = Annotated[
    bool,
    typer.Option(
        "--sealed", help="The truth is secret: rounded scores, no pages of results, no output."
    ),
]
PerDayOption = Annotated[
    int, typer.Option(min=1, max=1000, help="Submissions a day, of one participant.")
]
InAllOption = Annotated[
    int, typer.Option(min=1, max=100_000, help="Submissions in a phase, of one participant.")
]


@app.callback()
def _group() -> None:
    """Benchmarks and results for other platforms: Codabench, EvalAI, Hugging Face."""


def _competition(
    protocol: str,
    data: str | None,
    phases: list[str],
    sealed: bool,
    per_day: int,
    in_all: int,
    *,
    endless: bool,
) -> Competition:
    from airzoo_bench.leaderboard.exports.bundle import open_competition
    from airzoo_bench.leaderboard.exports.phases import read_phases

    spans = read_phases(phases, endless=endless)
    return open_competition(
        protocol, resolve_data(data), spans, sealed=sealed, per_day=per_day, in_all=in_all
    )


@app.command(
    epilog=examples(
        "export codabench airzoo-mini-retrieval --docker-image registry.example.org/airzoo-bench:1 "
        "--phase Test,2027-01-01,2027-03-01 --out codabench"
    )
)
def codabench(
    protocol: ProtocolArgument,
    docker_image: Annotated[
        str, typer.Option(help="Where the image will lie that the Dockerfile makes.")
    ],
    phase: PhasesOption,
    out: OutOption,
    data: DataOption = None,
    sealed: SealedOption = False,
    per_day: PerDayOption = 2,
    in_all: InAllOption = 20,
    seconds: Annotated[
        int, typer.Option(min=60, max=86_400, help="Time limit of a scoring run.")
    ] = 600,
) -> None:
    """Write a competition bundle for Codabench, and the Dockerfile of the image that scores it."""
    from airzoo_bench.leaderboard.exports.codabench import export_codabench

    competition = _competition(protocol, data, phase, sealed, per_day, in_all, endless=True)
    written = export_codabench(competition, out, docker_image=docker_image, seconds=seconds)
    for path in written:
        put(f"{path}\n")
    say(f"next: docker build -t {docker_image} {out}, push it, and upload {written[0]}")


@app.command(
    epilog=examples(
        "export evalai airzoo-mini-retrieval --phase Test,2027-01-01,2027-03-01 --out evalai"
    )
)
def evalai(
    protocol: ProtocolArgument,
    phase: PhasesOption,
    out: OutOption,
    data: DataOption = None,
    sealed: SealedOption = False,
    per_day: PerDayOption = 2,
    in_all: InAllOption = 20,
) -> None:
    """Write a challenge for EvalAI, and the folder of the worker that scores it at the host's."""
    from airzoo_bench.leaderboard.exports.evalai import export_evalai

    competition = _competition(protocol, data, phase, sealed, per_day, in_all, endless=False)
    written = export_evalai(competition, out)
    for path in written:
        put(f"{path}\n")
    say(
        f"next: upload {written[0]}, then run "
        f"python3 -m airzoo_bench.leaderboard.exports.evalai_worker {written[1]}"
    )


@app.command(
    epilog=examples(
        "export huggingface runs/* --dataset airzoo/leaderboard --licence cc-by-4.0 --out hub"
    )
)
def huggingface(
    results: Annotated[
        list[Path], typer.Argument(help="Result files, or the folders that hold one.")
    ],
    dataset: Annotated[str, typer.Option(help="The dataset to be, ORGANISATION/NAME.")],
    licence: Annotated[str, typer.Option(help="Of the results: an id of SPDX or of the hub.")],
    out: OutOption,
    title: Annotated[str, typer.Option(help="Of the dataset.")] = "AirZoo leaderboard",
    framework: Annotated[
        str, typer.Option(help="Name of the evaluation framework on the hub's list.")
    ] = "airzoo-bench",
    source: Annotated[
        str | None, typer.Option(help="Address that pages of models link to, such as the board's.")
    ] = None,
) -> None:
    """Write results as a dataset for Hugging Face, with the files of community evaluations."""
    from airzoo_bench.leaderboard.exports.huggingface import HubTarget, export_huggingface

    target = HubTarget(dataset, title, licence, framework, source)
    written = export_huggingface(results, out, target)
    for path in written:
        put(f"{path}\n")
    say(
        f"next: hf upload {dataset} {written[0]} --repo-type dataset; "
        f"{written[1]}/*/.eval_results go into the methods' model repositories"
    )
