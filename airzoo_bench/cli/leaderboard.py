"""``airzoo-bench leaderboard``: a board of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli import leaderboard_ci, leaderboard_site
from airzoo_bench.cli.common import examples, put, say

__all__ = ["app"]

app = typer.Typer(
    help="A board in a repository of your own: its files, its CI, its pages.",
    no_args_is_help=True,
)


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


app.command("build", epilog=leaderboard_site.BUILD_EXAMPLES)(leaderboard_site.build)
app.command("serve", epilog=leaderboard_site.SERVE_EXAMPLES)(leaderboard_site.serve)
app.add_typer(leaderboard_ci.app, name="ci")
