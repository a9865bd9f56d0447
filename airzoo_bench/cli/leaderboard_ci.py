"""``airzoo-bench leaderboard ci``: the steps that the workflows of a board call."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

import typer

from airzoo_bench.cli.common import JobsOption, MemoryOption, examples, memory_bytes, put, say
from airzoo_bench.cli.locations import DataOption, resolve_data
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.leaderboard.ci.artifact import Artifact
    from airzoo_bench.leaderboard.ci.ledger import Outcome as Word
    from airzoo_bench.leaderboard.ci.scoring import Rules

__all__ = ["app"]

T = TypeVar("T")

app = typer.Typer(
    help="Steps of a board's CI; its workflows call them.",
    no_args_is_help=True,
)

EventOption = Annotated[
    Path,
    typer.Option(help="The event as GitHub writes it."),
]
RemoteOption = Annotated[
    str,
    typer.Option(help="URL or folder of the repository; $GIT_TOKEN is sent to it."),
]
RootOption = Annotated[
    Path, typer.Option(help="A checkout of the board's own branch, with leaderboard.toml.")
]
BranchOption = Annotated[str, typer.Option(help="The branch that submissions are merged into.")]
ArtifactOption = Annotated[Path, typer.Option(help="What an earlier step has found.")]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="The file to write.")]
WorkOption = Annotated[Path, typer.Option(help="A folder to work in, which does not exist yet.")]


class Outcome(StrEnum):
    """What became of a try."""

    STARTED = "started"
    SCORED = "scored"
    FAILED = "failed"
    MERGED = "merged"


@app.callback()
def _group() -> None:
    """Run a step of a board's CI; its workflows call these."""


@app.command(epilog=examples("leaderboard ci score --event event.json --remote . -o found.json"))
def score(
    event: EventOption,
    remote: RemoteOption,
    out: OutOption,
    work: WorkOption = Path("work"),
    root: RootOption = Path(),
    branch: BranchOption = "main",
    data: DataOption = None,
    max_memory: MemoryOption = "4G",
    jobs: JobsOption = 2,
    outputs: Annotated[
        Path | None,
        typer.Option(help="File to append kind=... to: $GITHUB_OUTPUT.", show_default=False),
    ] = None,
) -> None:
    """Fetch a pull request as objects, check it, and score it where the truth is public.

    Exit code 0 if it may be merged, 1 if it is refused, 2 where the event or the
    board is at fault.
    """
    from airzoo_bench.leaderboard.ci.artifact import write_artifact
    from airzoo_bench.leaderboard.ci.event import read_event
    from airzoo_bench.leaderboard.ci.scoring import score_pull_request

    _check_empty(work)
    rules = _rules(root, branch, data, max_memory, jobs)
    found = score_pull_request(read_event(event), remote, rules, work.resolve())
    write_artifact(out, found)
    if outputs is not None:
        with outputs.open("a", encoding="utf-8") as stream:
            stream.write(f"kind={found.kind}\n")
    _tell(found)
    put(f"{found.kind}\n")
    if found.kind == "refused":
        raise typer.Exit(1)


@app.command(epilog=examples("leaderboard ci ledger started --artifact found.json --remote URL"))
def ledger(
    outcome: Annotated[
        Outcome, typer.Argument(help="What became of it; started comes before a sealed truth.")
    ],
    remote: RemoteOption,
    artifact: Annotated[
        list[Path] | None,
        typer.Option(
            help="What earlier steps have found; the last that exists is it.", show_default=False
        ),
    ] = None,
    event: Annotated[
        Path | None,
        typer.Option(help="Of the merge, for merged.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Where to write what was found, also where refused."),
    ] = None,
    root: RootOption = Path(),
) -> None:
    """Enter a try into the ledger, and keep the answer of a sealed truth.

    "started" is refused, with exit code 1, where the account has no try left: two
    jobs at once cannot both have the last one. "failed" gives a try back that
    failed by no fault of the submission. "merged" makes the account of the pull
    request the owner of the submission's folder.
    """
    from airzoo_bench.leaderboard.ci.artifact import read_artifact, write_artifact
    from airzoo_bench.leaderboard.ci.entries import enter, enter_merge
    from airzoo_bench.leaderboard.ci.event import read_event

    if outcome is Outcome.MERGED:
        say(enter_merge(read_event(_needed(event, "--event")), remote))
        return
    given = _needed(artifact, "--artifact")
    word = cast("Word", outcome.value)
    found = enter(read_artifact(_last(given)), word, remote, root)
    if out is not None:
        write_artifact(out, found)
    _tell(found)
    if found.kind == "refused":
        raise typer.Exit(1)


@app.command(epilog=examples("leaderboard ci sealed --artifact found.json -o answer.json"))
def sealed(
    artifact: ArtifactOption,
    out: OutOption,
    work: Annotated[Path, typer.Option(help="The folder of the step `score`.")] = Path("work"),
    root: RootOption = Path(),
    key: Annotated[
        Path | None,
        typer.Option(help="File of the key (default: $AIRZOO_BENCH_KEY).", show_default=False),
    ] = None,
    data: DataOption = None,
    max_memory: MemoryOption = "4G",
    jobs: JobsOption = 2,
) -> None:
    """Score what was checked against the sealed truth, without any network."""
    from airzoo_bench.leaderboard.ci.artifact import read_artifact, write_artifact
    from airzoo_bench.leaderboard.ci.sealed import check_no_network, score_against_truth
    from airzoo_bench.leaderboard.sealed.keys import read_key

    check_no_network()
    rules = _rules(root, "", data, max_memory, jobs)
    found = score_against_truth(read_artifact(artifact), work.resolve(), rules, read_key(key))
    write_artifact(out, found)
    _tell(found)


@app.command(epilog=examples("leaderboard ci comment found.json -o comment.md"))
def comment(
    artifacts: Annotated[
        list[Path], typer.Argument(help="Of all steps in their order; the last that exists is it.")
    ],
    out: OutOption,
) -> None:
    """Write the comment on a pull request, in Markdown, from what was found alone."""
    from airzoo_bench.core.files import atomic_write
    from airzoo_bench.leaderboard.ci.artifact import read_artifact
    from airzoo_bench.leaderboard.ci.comment import comment_on

    with atomic_write(out, "w") as stream:
        stream.write(comment_on(read_artifact(_last(artifacts))))


@app.command(epilog=examples("leaderboard ci rescore --remote . --out runs"))
def rescore(
    remote: RemoteOption,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="A new folder for all runs, old and new.")
    ],
    root: RootOption = Path(),
    branch: BranchOption = "main",
    data: DataOption = None,
    max_memory: MemoryOption = "4G",
    jobs: JobsOption = 2,
) -> None:
    """Score what was merged and has no run, or one of an earlier protocol or truth.

    Exit code 1 if any of it cannot be scored.
    """
    from airzoo_bench.leaderboard.ci.merging import score_merged

    _check_empty(out)
    rules = _rules(root, branch, data, max_memory, jobs)
    faulty = False
    for one in score_merged(remote, rules, out):
        faulty |= one.fault is not None
        _say(f"{one.place.path}: {one.said if one.fault is None else one.fault}")
    if faulty:
        raise typer.Exit(1)


@app.command(epilog=examples("leaderboard ci record runs --remote URL"))
def record(
    runs: Annotated[Path, typer.Argument(help="The folder of the step `rescore`.")],
    remote: RemoteOption,
) -> None:
    """Put new runs onto the branch of the data."""
    import tempfile

    from airzoo_bench.leaderboard.ci.data_branch import DataBranch
    from airzoo_bench.leaderboard.ci.merging import record_runs

    with tempfile.TemporaryDirectory() as folder:
        for path in record_runs(DataBranch.open(Path(folder) / "data.git", remote), runs):
            put(f"{path}\n")


def _rules(root: Path, branch: str, data: str | None, max_memory: str, jobs: int) -> Rules:
    from airzoo_bench.core.sandbox import Limits, check_limits
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.ci.scoring import Rules

    check_limits()
    memory = memory_bytes(max_memory)
    run = Run(memory, jobs=jobs, limits=Limits(memory))
    board = read_board(root / BOARD_FILE)
    return Rules(board, root, branch, resolve_data(data), run, _say)


def _check_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError("is not a new or empty folder", where=folder, fix="name another one")


def _last(paths: list[Path]) -> Path:
    """Return the last that is there; of none the last, whose reader says that it is missing."""
    return next((path for path in reversed(paths) if path.is_file()), paths[-1])


def _needed(given: T | None, option: str) -> T:
    if not given:
        raise UsageError(f"this outcome needs {option}", fix=f"add {option} FILE")
    return given


def _tell(found: Artifact) -> None:
    for problem in found.problems:
        _say(str(problem.error()))
    for line in (*found.claimed, *found.warnings):
        _say(line)


def _say(text: str) -> None:
    """Print lines of which none is a command to the runner: those begin with :: or hold ##[."""
    say("\n".join(f"| {line}" for line in text.replace("##[", "# #[").split("\n")))
