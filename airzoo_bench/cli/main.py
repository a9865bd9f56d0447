"""Entry point: all commands, each imported when it is chosen, and exit codes.

0 done; 1 a check found something wrong; 2 the input is wrong; 70 a bug of the suite; 130 stopped.
"""

from __future__ import annotations

import io
import re
import sys
import traceback
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperOption

from airzoo_bench.cli.common import LightGroup, in_panels, say
from airzoo_bench.cli.remedies import options_of, own_ways
from airzoo_bench.core.errors import UserError

__all__ = ["app", "main"]

_INPUT_IS_WRONG = 2
_BUG = 70
_MOST_NEIGHBOURS = 10_000


@dataclass(frozen=True)
class _Place:
    """Where a command is: a function or a group of commands in a module of this folder."""

    module: str
    attribute: str
    help: str
    examples: str = "EXAMPLES"


_COMMANDS: dict[str, dict[str, _Place]] = {
    "Score": {
        "eval": _Place("evaluate", "app", "Score predictions and print the per-scene table."),
        "check": _Place("check", "check", "List every error of predictions."),
        "readers": _Place("readers", "readers", "List the readers of methods' own files."),
        "template": _Place("template", "template", "Write an example prediction."),
        "baseline": _Place("baseline", "app", "Run a plain method that needs no weights."),
    },
    "Results": {
        "table": _Place("table", "table", "Print results as a table: terminal, LaTeX, CSV ..."),
        "compare": _Place("compare", "compare", "Compare methods query by query, with tests."),
        "breakdown": _Place("breakdown", "breakdown", "Print scores by weather, altitude ..."),
        "plot": _Place("plot", "app", "Draw results as pictures."),
        "report": _Place("report", "report", "Write a report: one HTML file with everything."),
    },
    "Data": {
        "prepare": _Place("prepare", "app", "Make a benchmark folder out of data."),
        "download": _Place("download", "download", "Fetch a published benchmark, or its links."),
        "manifest": _Place("manifest", "manifest", "Fill in benchmark.toml of your own folder."),
        "protocols": _Place("protocols", "protocols", "List all protocols, or print one."),
    },
    "Checks": {
        "audit": _Place("audit", "audit", "Check a published table against arithmetic."),
        "check-geometry": _Place(
            "check_geometry",
            "check_geometry",
            "Check frames and depth of a dataset.",
            "GEOMETRY_EXAMPLES",
        ),
        "check-split": _Place(
            "check_geometry",
            "check_split",
            "Check that two sets see no common ground.",
            "SPLIT_EXAMPLES",
        ),
    },
    "Leaderboard": {
        "submit": _Place("submit", "submit", "Submit predictions to a board."),
        "submission": _Place("submit", "app", "Check a submission before it is sent."),
        "leaderboard": _Place("leaderboard", "app", "A board of your own: files, CI, pages."),
        "seal": _Place("seal", "seal", "Split a benchmark from its truth.", "SEAL_EXAMPLES"),
        "seal-score": _Place(
            "seal", "seal_score", "Score against a sealed truth.", "SCORE_EXAMPLES"
        ),
    },
    "AirZoo-Mini, which needs no data": {
        "demo": _Place("demo", "demo", "Run a plain method on every track, and print the tables."),
        "mini": _Place("mini", "app", "Make the world of AirZoo-Mini, and photos of it."),
    },
}


class _Main(LightGroup):
    """All commands, in panels; the help imports none of them."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [*(name for part in _COMMANDS.values() for name in part), *self.commands]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command."""
        place = next((part[cmd_name] for part in _COMMANDS.values() if cmd_name in part), None)
        if place is not None and cmd_name not in self._built:
            self._built[cmd_name] = _command(cmd_name, place)
        return self._built.get(cmd_name) or super().get_command(ctx, cmd_name)

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self._built: dict[str, Any] = {}

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands panel by panel."""
        for panel, places in _COMMANDS.items():
            with formatter.section(panel):
                formatter.write_dl([(name, place.help) for name, place in places.items()])


def _command(name: str, place: _Place) -> Any:
    module = import_module(f"airzoo_bench.cli.{place.module}")
    found = getattr(module, place.attribute)
    if isinstance(found, typer.Typer):
        group = typer.main.get_group(found)
        group.name = name
        return group
    app = typer.Typer(add_completion=False)
    panels = in_panels(getattr(module, "PANELS", {}))
    app.command(name, cls=panels, epilog=getattr(module, place.examples))(found)
    return typer.main.get_command(app)


_display_type = TyperOption.display_type_rich


def _breakable_type(option: TyperOption, ctx: Any) -> str:
    """Return the type that the help shows, with choices that a line may end between."""
    return (_display_type(option, ctx) or "").replace("|", "| ")


# Typer writes choices without blanks, which narrow terminals break in mid-word.
TyperOption.display_type_rich = _breakable_type  # type: ignore[method-assign, assignment]

app = typer.Typer(
    name="airzoo-bench",
    cls=_Main,
    help="Scores predictions for aerial 3D vision: image retrieval, cross-view matching, "
    "multi-view reconstruction.",
    epilog="Start with: airzoo-bench demo, or airzoo-bench eval retrieval preds.npz",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # rich takes as long to import as all else
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from airzoo_bench.core.version import __version__

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
        _refuse(error)
    except MemoryError as error:
        fix = "lower --max-memory, or lower --jobs, or run it on a machine with more memory"
        _refuse(UserError(f"not enough memory ({error})", fix=fix))
    except OSError as error:
        where = str(error.filename or "a file")[:200]
        _refuse(UserError(error.strerror or str(error), where=where))
    except Exception:  # noqa: BLE001 - the one place where a bug is reported as a bug
        traceback.print_exc()
        say("airzoo-bench: this is a bug of the suite, not of your input: please report it")
        sys.exit(_BUG)


def _refuse(error: UserError) -> NoReturn:
    """Say what is wrong, and only such ways to mend it as the command has."""
    error.fix = own_ways(error.fix, options_of(typer.main.get_command(app), sys.argv[1:]))
    say(f"airzoo-bench: {error}{_near_path(error)}")
    sys.exit(_INPUT_IS_WRONG)


def _near_path(error: UserError) -> str:
    """Offer the name next to a path that is not there and is most like it."""
    path = Path(re.sub(r"^--\S+ ", "", error.where or ""))
    if not error.what.startswith("no such") or path.exists() or not path.parent.is_dir():
        return ""
    from airzoo_bench.core.validation import near_names

    names = [entry.name for entry in islice(path.parent.iterdir(), _MOST_NEIGHBOURS)]
    near = near_names(path.name, names, 1)
    return f"\n  nearest:  {path.parent / near[0]}" if near else ""
