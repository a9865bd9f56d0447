"""``airzoo-bench leaderboard`` and ``seal``: a board, the steps of its CI, its sealed truth."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import Text, echo, examples, option, progress, say, working
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, data_root
from airzoo_bench.core.sandbox import Limits, check_limits
from airzoo_bench.leaderboard.answers import now
from airzoo_bench.leaderboard.board import BOARD_FILE, read_board, write_starter
from airzoo_bench.leaderboard.comment import Found, comment_on, read_found
from airzoo_bench.leaderboard.pages import build_board

app = typer.Typer(help="A board: its files, CI and pages.", no_args_is_help=True)

RemoteOption = Annotated[str, option("The repository; $GIT_TOKEN is sent to it.", "--remote")]
RootOption = Annotated[Path, option("A checkout of the board's own branch.", "--root")]
OutOption = Annotated[Path, option("The file or folder to write.", "--out", "-o")]

_MEMORY_BYTES = 4 << 30
_SITE = Path("site")


@app.command(epilog=examples("leaderboard init board", "leaderboard init . --repository lab/board"))
def init(
    folder: Annotated[Path, typer.Argument(help="A repository, or a folder to become one.")],
    repository: Annotated[Text, option("Its name where it is hosted, such as lab/board.")] = None,
) -> None:
    """Write the files of a board of AirZoo-Mini: leaderboard.toml, workflows, a README.

    Put your own benchmark in its place afterwards. No file is replaced.
    """
    for path in write_starter(folder, repository):
        echo(f"{path}\n")
    say("docs/leaderboard.md of airzoo-bench, 'From an empty repository', has the settings to make")


@app.command(epilog=examples("leaderboard score --remote . --out board-data"))
def score(
    out: OutOption,
    remote: RemoteOption = ".",
    event: Annotated[Path | None, option("GitHub's, of a pull request (default: merged).")] = None,
    sealed: Annotated[Path | None, option("Findings, to score by $AIRZOO_BENCH_KEY.")] = None,
    work: Annotated[Path, option("A folder to work in.")] = Path("work"),
    root: RootOption = Path(),
) -> None:
    """Score a pull request, a sealed submission, or all merged submissions without a score.

    Exit code 0 if all is well, 1 if a submission is refused or cannot be scored,
    2 if the event or the board is wrong.
    """
    from airzoo_bench.evaluation.track import Run  # loads GDAL, which pages do without
    from airzoo_bench.leaderboard import scoring
    from airzoo_bench.leaderboard.checks import Rules
    from airzoo_bench.leaderboard.git import read_event

    check_limits()
    run = Run(_MEMORY_BYTES, os.cpu_count() or 1, keep=True, limits=Limits(_MEMORY_BYTES))
    rules = Rules(read_board(root / BOARD_FILE), root, data_root(), run)
    if sealed is not None:
        _finish(scoring.score_against_truth(read_found(sealed), work.resolve(), rules), out)
        return
    folder = out if event is None else work
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError("is not a new or empty folder", where=folder, fix="name another one")
    if event is not None:
        _finish(scoring.score_pull_request(read_event(event), remote, rules, work.resolve()), out)
        return
    faults = 0
    for place, said in scoring.score_merged(remote, rules, out):
        faults += not isinstance(said, str)
        _say(f"{place.path}: {said}")
    raise typer.Exit(min(faults, 1))


@app.command(epilog=examples("leaderboard comment found.json -o comment.md"))
def comment(
    findings: Annotated[list[Path], typer.Argument(help="Of all steps; the last one counts.")],
    out: OutOption,
) -> None:
    """Write the comment on a pull request, in Markdown, from the findings alone."""
    last = next((path for path in reversed(findings) if path.is_file()), findings[-1])
    with atomic_write(out, "w") as stream:
        stream.write(comment_on(read_found(last)))


@app.command(epilog=examples("leaderboard keep board-data --remote URL"))
def keep(
    found: Annotated[Path, typer.Argument(help="A folder of runs, or findings on a sealed one.")],
    remote: RemoteOption,
    started: Annotated[bool, option("Take a try, before scoring.", "--started")] = False,
    out: Annotated[Path | None, option("The file of findings to write.", "--out", "-o")] = None,
    root: RootOption = Path(),
) -> None:
    """Put runs, tries and answers of sealed truths onto the branch of the board's data.

    Exit code 1 if the account has no try left.
    """
    from airzoo_bench.leaderboard.git import DataBranch, RefusedError, Try

    with tempfile.TemporaryDirectory() as folder:
        branch = DataBranch(Path(folder) / "data", remote)
        if found.is_dir():
            branch.add_runs(found)
            return
        finding = read_found(found)
        outcome = "started" if started else "scored" if finding.opened else "failed"
        benchmark = finding.place.benchmark if finding.place else ""
        line = Try(str(finding.account), benchmark, finding.head, outcome, now())
        try:
            branch.add_try(line, read_board(root / BOARD_FILE).limits, finding.answer)
        except RefusedError as error:
            finding = finding.model_copy(update={"kind": "refused", "problems": (str(error),)})
    _finish(finding, out)


@app.command(epilog=examples("leaderboard build --runs board-data --out site"))
def build(
    runs: Annotated[Path, option("The --out of `leaderboard score`.")],
    out: Annotated[Path, option("The site, in place of an earlier one.", "--out", "-o")] = _SITE,
    root: RootOption = Path(),
) -> None:
    """Make the static site of a board: board.json, tables, pages. See docs/leaderboard.md.

    A submission that cannot be shown is a grey row with the reason. A second build compares only
    changed results, by SITE.cache, which is safe to delete.
    """
    if not (runs / "runs").is_dir():
        raise UsageError("no folder of runs", where=runs, expected="the --out of `score`")
    rules = read_board(root / BOARD_FILE)
    with working("building the board"):
        faults = build_board(runs, root / "submissions", rules, data_root(), out)
    for fault in faults:
        say(fault)
    echo(f"{out / 'index.html'}\n")


@app.command(epilog=examples("leaderboard serve site"))
def serve(
    site: Annotated[Path, typer.Argument(help="The folder that `leaderboard build` made.")] = _SITE,
    port: Annotated[int, option("0: any free port.", min=0, max=65535)] = 8000,
) -> None:
    """Serve a built site to this machine only, until Ctrl-C."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", port), handler) as server, suppress(KeyboardInterrupt):
        echo("http://{}:{}/ (Ctrl-C ends it)\n".format(*server.server_address))
        server.serve_forever()


def seal(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with all its data in it.")],
    out: Annotated[Path, option("The public folder; the archive is OUT.age.", "--out", "-o")],
    to: Annotated[str, option("The host's public key, age1...")],
) -> None:
    """Split a benchmark folder into a public one without the truth, and an archive with it.

    Methods get photos without metadata, cameras, priors, tiles, crops and maps;
    docs/leaderboard.md says what else to consider. Only the key opens the archive.

    Example: airzoo-bench seal mine --out public/mine --to age1...
    """
    from airzoo_bench.leaderboard import sealing

    archive, commitment = sealing.seal(folder, out, sealing.recipient(to), progress)
    echo(f"{out}\n{archive}\n")
    say(f"commitment {commitment}")


def _finish(found: Found, out: Path | None) -> None:
    """Write and print the findings; the last line is their kind."""
    if out is not None:
        with atomic_write(out, "w") as stream:
            stream.write(found.model_dump_json(indent=1) + "\n")
    for line in (*found.problems, *found.warnings):
        _say(line)
    echo(f"{found.kind}\n")
    if found.kind == "refused":
        raise typer.Exit(1)


def _say(text: str) -> None:
    """Print lines so that the runner takes none for a command (they begin with :: or hold ##[)."""
    say("\n".join(f"| {line}" for line in text.replace("##[", "# #[").split("\n")))
