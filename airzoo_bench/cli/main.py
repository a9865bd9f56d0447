"""Entry point: all commands, each imported when it is chosen, and exit codes.

0 done; 1 a check found something wrong; 2 the input is wrong; 70 a bug of the suite; 130 stopped.
"""

from __future__ import annotations

import io
import sys
import textwrap
import traceback
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import typer

from airzoo_bench.cli.common import LightGroup, PanelCommand, say
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.version import __version__

_INPUT_IS_WRONG = 2
_BUG = 70

# By panel and name: a function or a group of commands in a module of this folder, and its help.
_COMMANDS: dict[str, dict[str, tuple[str, str]]] = {
    "Score": {
        "eval": ("evaluate:evaluate", "Score predictions and print the per-scene table."),
        "check": ("evaluate:check", "Find errors of predictions."),
        "readers": ("methods:readers", "List the readers of methods' own files."),
        "template": ("methods:template", "Write an example prediction."),
        "baseline": ("methods:baseline", "Run a plain method that needs no weights."),
    },
    "Results": {
        "table": ("table:table", "Print results as a table: terminal, LaTeX, CSV ..."),
        "compare": ("results:compare", "Compare methods query by query, with tests."),
        "breakdown": ("results:breakdown", "Print scores by weather, altitude ..."),
        "plot": ("results:plot", "Draw results as pictures."),
        "report": ("results:report", "Write a report: one HTML file with everything."),
    },
    "Data": {
        "prepare": ("prepare:app", "Make a benchmark folder out of data."),
        "download": ("data:download", "Fetch a published benchmark, or its links."),
        "manifest": ("data:manifest", "Fill in benchmark.toml of your own folder."),
        "protocols": ("data:protocols", "List all protocols, or print one."),
    },
    "Checks": {
        "audit": ("checks:audit", "Check a published table against arithmetic."),
        "check-geometry": ("checks:check_geometry", "Check frames and depth of a dataset."),
        "check-split": ("checks:check_split", "Check that two sets see no common ground."),
    },
    "Leaderboard": {
        "submit": ("submit:submit", "Submit predictions to a board."),
        "submission": ("submit:app", "Check a submission before it is sent."),
        "leaderboard": ("leaderboard:app", "A board of your own: files, CI, pages."),
        "seal": ("leaderboard:seal", "Split a benchmark from its truth."),
    },
    "AirZoo-Mini, which needs no data": {
        "demo": ("methods:demo", "Run a plain method on every track of a demo."),
        "mini": ("data:mini", "Take photos of the world of AirZoo-Mini."),
    },
}
_PLACES = {name: place for panel in _COMMANDS.values() for name, place in panel.items()}

typer.core.HAS_RICH = False  # which takes as long to import as all else
# Lines of the help end between words, never within --image-size.
textwrap.TextWrapper.wordsep_re = textwrap.TextWrapper.wordsep_simple_re


class _Main(LightGroup):
    """All commands, in panels; the help imports none of them."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [*_PLACES]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command."""
        return _build_command(cmd_name) if cmd_name in _PLACES else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands panel by panel."""
        for panel, places in _COMMANDS.items():
            with formatter.section(panel):
                formatter.write_dl([(name, place[1]) for name, place in places.items()])


@cache
def _build_command(name: str) -> Any:
    home, attribute = _PLACES[name][0].split(":")
    module = import_module(f"airzoo_bench.cli.{home}")
    found = getattr(module, attribute)
    if isinstance(found, typer.Typer):
        group = typer.main.get_group(found)
        group.name = name
        return group
    app = typer.Typer(add_completion=False)
    app.command(name, cls=PanelCommand)(found)
    command: Any = typer.main.get_command(app)
    panels = getattr(module, "PANELS", {})
    command.panels = {one: title for title, names in panels.items() for one in names}
    return command


app = typer.Typer(
    name="airzoo-bench",
    cls=_Main,
    help="Scores predictions for aerial 3D vision: image retrieval, cross-view matching, "
    "multi-view reconstruction.",
    epilog="Start with: airzoo-bench demo, or airzoo-bench eval retrieval preds.npz",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"airzoo-bench {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="The version.")
    ] = False,
) -> None:
    del version


def main() -> None:
    """Run the command line; errors become a message and an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Not every terminal or pipe has a code for every letter of a name.
            stream.reconfigure(errors="backslashreplace")
    try:
        app(standalone_mode=True)
    except UserError as error:
        refusal = error
    except MemoryError as error:
        fix = "lower --max-memory or --jobs, or run it on a machine with more memory"
        refusal = UserError(f"not enough memory ({error})", fix=fix)
    except OSError as error:
        where = str(error.filename or "a file")[:200]
        refusal = UserError(error.strerror or str(error), where=where)
    except Exception:  # noqa: BLE001 - the one place where a bug is reported as a bug
        traceback.print_exc()
        say("airzoo-bench: this is a bug of the suite, not of your input: please report it")
        sys.exit(_BUG)
    say(f"airzoo-bench: {refusal}")
    sys.exit(_INPUT_IS_WRONG)
