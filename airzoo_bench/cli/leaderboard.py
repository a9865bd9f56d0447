"""``airzoo-bench leaderboard``: a board of one's own, and the steps of its CI."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import (
    JobsOption,
    MemoryOption,
    examples,
    memory_bytes,
    put,
    say,
    working,
)
from airzoo_bench.cli.locations import DataOption, resolve_data
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.leaderboard.artifact import Artifact
    from airzoo_bench.leaderboard.scoring import Rules

__all__ = ["app"]

app = typer.Typer(
    help="A board in a repository of your own: its files, its CI, its pages.",
    no_args_is_help=True,
)

RemoteOption = Annotated[
    str, typer.Option(help="URL or folder of the repository; $GIT_TOKEN is sent to it.")
]
RootOption = Annotated[
    Path, typer.Option(help="A checkout of the board's own branch, with leaderboard.toml.")
]
OutOption = Annotated[Path | None, typer.Option("--out", "-o", help="The file to write.")]

_RUNS, _BOARD, _SITE = Path("runs"), Path("leaderboard.toml"), Path("site")


@app.callback()
def _group() -> None:
    """Make and run a board in a repository of your own."""


@app.command(epilog=examples("leaderboard init board", "leaderboard init . --repository lab/board"))
def init(
    folder: Annotated[Path, typer.Argument(help="A repository, or a folder to become one.")],
    repository: Annotated[
        str | None,
        typer.Option(help="Its name where it is hosted, such as lab/board.", show_default=False),
    ] = None,
) -> None:
    """Write the files of a board: leaderboard.toml, workflows, folders, docs for submitters.

    The board is of AirZoo-Mini, so that everything can be tried at once; put your
    own benchmark in its place afterwards. No file is replaced.
    """
    from airzoo_bench.leaderboard.starter.write import next_steps, write_starter

    for path in write_starter(folder, repository):
        put(f"{path}\n")
    for line in next_steps(folder):
        say(line)


@app.command(
    epilog=examples(
        "leaderboard score --event event.json --remote . -o found.json",
        "leaderboard score --remote . --out board-data",
    )
)
def score(
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="The file of findings, or the new folder of all runs."),
    ],
    remote: Annotated[
        str, typer.Option(help="URL or folder of the repository; $GIT_TOKEN is sent to it.")
    ] = ".",
    event: Annotated[
        Path | None,
        typer.Option(
            help="The event of a pull request as GitHub writes it (default: score all that was "
            "merged).",
            show_default=False,
        ),
    ] = None,
    sealed: Annotated[
        Path | None,
        typer.Option(
            help="Findings on a sealed submission, to be scored with the key in "
            "$AIRZOO_BENCH_KEY, without network.",
            show_default=False,
        ),
    ] = None,
    work: Annotated[Path, typer.Option(help="A folder to work in.")] = Path("work"),
    root: RootOption = Path(),
    branch: Annotated[str, typer.Option(help="The branch to merge submissions into.")] = "main",
    data: DataOption = None,
    max_memory: MemoryOption = "4G",
    jobs: JobsOption = 2,
) -> None:
    """Score a pull request, a sealed submission, or all merged submissions without a score.

    Exit code 0 if all is well, 1 where a submission is refused or cannot be scored,
    2 where the event or the board is at fault.
    """
    from airzoo_bench.leaderboard.artifact import read_artifact, write_artifact
    from airzoo_bench.leaderboard.keys import read_key
    from airzoo_bench.leaderboard.pull_request import read_event
    from airzoo_bench.leaderboard.scoring import (
        score_against_truth,
        score_merged,
        score_pull_request,
    )

    rules = _rules(root, branch, data, max_memory, jobs)
    if sealed is not None:
        found = score_against_truth(read_artifact(sealed), work.resolve(), rules, read_key(None))
    elif event is not None:
        _check_empty(work)
        found = score_pull_request(read_event(event), remote, rules, work.resolve())
    else:
        _check_empty(out)
        faults = 0
        for place, said in score_merged(remote, rules, out):
            faults += not isinstance(said, str)
            _say(f"{place.path}: {said}")
        raise typer.Exit(min(faults, 1))
    write_artifact(out, found)
    _finish(found)


@app.command(epilog=examples("leaderboard comment found.json -o comment.md"))
def comment(
    artifacts: Annotated[
        list[Path], typer.Argument(help="Findings of all steps; the last that exists counts.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="The file to write.")],
) -> None:
    """Write the comment on a pull request, in Markdown, from the findings alone."""
    from airzoo_bench.core.files import atomic_write
    from airzoo_bench.leaderboard.artifact import read_artifact
    from airzoo_bench.leaderboard.comment import comment_on

    last = next((path for path in reversed(artifacts) if path.is_file()), artifacts[-1])
    with atomic_write(out, "w") as stream:
        stream.write(comment_on(read_artifact(last)))


@app.command(
    epilog=examples(
        "leaderboard keep board-data --remote URL",
        "leaderboard keep found.json --started --remote URL -o found-try.json",
    )
)
def keep(
    found: Annotated[
        Path, typer.Argument(help="A folder of runs, or the findings on a sealed submission.")
    ],
    remote: RemoteOption,
    started: Annotated[
        bool,
        typer.Option("--started", help="Take a try, before the truth is opened."),
    ] = False,
    out: OutOption = None,
    root: RootOption = Path(),
) -> None:
    """Put runs, tries and answers of sealed truths onto the branch of the board's data.

    Exit code 1 where the account has no try left: two jobs at once cannot both
    have the last one.
    """
    from airzoo_bench.leaderboard.artifact import problem_of, read_artifact, write_artifact
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.data_branch import DataBranch, Try
    from airzoo_bench.leaderboard.git import RefusedError
    from airzoo_bench.leaderboard.scoring import answer_path

    with DataBranch.opened(remote) as branch:
        if found.is_dir():
            for path in branch.add_runs(found):
                put(f"{path}\n")
            return
        finding = read_artifact(found)
        answer, limits = finding.answer, read_board(root / BOARD_FILE).limits
        outcome = "started" if started else "scored" if finding.truth else "failed"
        files = {}
        if answer is not None:
            files[answer_path(finding.tree)] = answer.model_dump_json(by_alias=True).encode()
        line = Try.now(finding.account, finding.place.benchmark, finding.head, outcome)
        try:
            branch.add_try(line, limits, files)
        except RefusedError as error:
            changes = {"kind": "refused", "problems": (problem_of(error),)}
            finding = finding.model_copy(update=changes)
    if out is not None:
        write_artifact(out, finding)
    _finish(finding)


@app.command(
    epilog=examples(
        "leaderboard build --out site", "leaderboard build results/*/result.json --out site"
    )
)
def build(
    results: Annotated[
        list[Path] | None,
        typer.Argument(help="Further results, or folders that hold one, beside the runs."),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The site's folder; an earlier board is replaced.")
    ] = _SITE,
    runs: Annotated[
        Path, typer.Option(help="Scored submissions: benchmark/track/folder/number/.")
    ] = _RUNS,
    submissions: Annotated[
        Path, typer.Option(help="Submissions, to show which have not been scored yet.")
    ] = Path("submissions"),
    board: Annotated[
        Path, typer.Option(help="The board's leaderboard.toml, if there is one.")
    ] = _BOARD,
    cache: Annotated[
        Path | None,
        typer.Option(help="Cache of builds; safe to delete (default: OUT.cache)."),
    ] = None,
    data: DataOption = None,
) -> None:
    """Make the static site of a board: board.json, tables, pages. See docs/leaderboard.md.

    A submission that cannot be shown is a grey row with the reason. The board that stands is
    replaced in one step; a second build measures only what has changed.
    """
    from airzoo_bench.leaderboard.board import read_board
    from airzoo_bench.leaderboard.build import Given, build_board

    if runs != _RUNS and not runs.is_dir():
        raise UsageError(
            "no folder of runs: the board would lose all that were scored",
            where=runs,
            fix="correct --runs, or leave it out where there are none",
        )
    if next(runs.glob("runs/*/*/*/*/run.json"), None) is not None:
        raise UsageError(
            "the folder above that of the runs",
            where=runs,
            expected="benchmark/track/folder/number/ in it",
            fix=f"--runs {runs / 'runs'}",
        )
    stated = read_board(board) if board.is_file() or board != _BOARD else None
    given = Given(runs, submissions, results or [], stated, resolve_data(data))
    kept = out.with_name(f"{out.name}.cache") if cache is None else cache
    with working("building the board"):
        build_board(given, out, kept, say)
    put(f"{out / 'index.html'}\n")


@app.command(epilog=examples("leaderboard serve site"))
def serve(
    site: Annotated[Path, typer.Argument(help="The folder that `leaderboard build` made.")] = _SITE,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 8000,
) -> None:
    """Show a built site at an address of this machine alone, until Ctrl-C."""
    from airzoo_bench.leaderboard.build import serve_folder

    serve_folder(site, port, put)


def _rules(root: Path, branch: str, data: str | None, max_memory: str, jobs: int) -> Rules:
    from airzoo_bench.core.sandbox import Limits, check_limits
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.scoring import Rules

    check_limits()
    memory = memory_bytes(max_memory)
    run = Run(memory, jobs=jobs, limits=Limits(memory))
    return Rules(read_board(root / BOARD_FILE), root, branch, resolve_data(data), run, _say)


def _check_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError("is not a new or empty folder", where=folder, fix="name another one")


def _finish(found: Artifact) -> None:
    """Print the findings; the last line is their kind."""
    for problem in found.problems:
        _say(str(problem.error()))
    for line in (*found.claimed, *found.warnings):
        _say(line)
    put(f"{found.kind}\n")
    if found.kind == "refused":
        raise typer.Exit(1)


def _say(text: str) -> None:
    """Print lines so that the runner takes none for a command (they begin with :: or hold ##[)."""
    say("\n".join(f"| {line}" for line in text.replace("##[", "# #[").split("\n")))
