"""``airzoo-bench leaderboard``: a public board of submissions."""

from __future__ import annotations

import typer

from airzoo_bench.cli import leaderboard_site

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="A public board of submissions.")
app.command("build", epilog=leaderboard_site.BUILD_EXAMPLES)(leaderboard_site.build)
app.command("serve", epilog=leaderboard_site.SERVE_EXAMPLES)(leaderboard_site.serve)
