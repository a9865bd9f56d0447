"""Entry point: all commands, each imported when it is chosen, and exit codes.

0 done; 1 a check found something wrong; 2 the input is wrong; 70 a bug of the suite; 130 stopped.
"""

from __future__ import annotations

import io
import re
import sys
import traceback
from collections.abc import Iterator, Sequence
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperOption

from airzoo_bench.cli.common import LightGroup, in_panels, say
from airzoo_bench.core.errors import UserError

_INPUT_IS_WRONG = 2
_BUG = 70
_MOST_NEIGHBOURS = 10_000

# By panel and name: a function or a group of commands in a module of this folder, its help, and the
# name of its examples there where that is not EXAMPLES.
_COMMANDS: dict[str, dict[str, tuple[str, ...]]] = {
    "Score": {
        "eval": ("evaluate:app", "Score predictions and print the per-scene table."),
        "check": ("check:check", "List every error of predictions."),
        "readers": ("readers:readers", "List the readers of methods' own files."),
        "template": ("template:template", "Write an example prediction."),
        "baseline": ("baseline:app", "Run a plain method that needs no weights."),
    },
    "Results": {
        "table": ("table:table", "Print results as a table: terminal, LaTeX, CSV ..."),
        "compare": ("compare:compare", "Compare methods query by query, with tests."),
        "breakdown": ("breakdown:breakdown", "Print scores by weather, altitude ..."),
        "plot": ("plot:app", "Draw results as pictures."),
        "report": ("report:report", "Write a report: one HTML file with everything."),
    },
    "Data": {
        "prepare": ("prepare:app", "Make a benchmark folder out of data."),
        "download": ("download:download", "Fetch a published benchmark, or its links."),
        "manifest": ("manifest:manifest", "Fill in benchmark.toml of your own folder."),
        "protocols": ("protocols:protocols", "List all protocols, or print one."),
    },
    "Checks": {
        "audit": ("audit:audit", "Check a published table against arithmetic."),
        "check-geometry": (
            *("check_geometry:check_geometry", "Check frames and depth of a dataset."),
            "GEOMETRY_EXAMPLES",
        ),
        "check-split": (
            *("check_geometry:check_split", "Check that two sets see no common ground."),
            "SPLIT_EXAMPLES",
        ),
    },
    "Leaderboard": {
        "submit": ("submit:submit", "Submit predictions to a board."),
        "submission": ("submit:app", "Check a submission before it is sent."),
        "leaderboard": ("leaderboard:app", "A board of your own: files, CI, pages."),
        "seal": ("seal:seal", "Split a benchmark from its truth.", "SEAL_EXAMPLES"),
        "seal-score": ("seal:seal_score", "Score against a sealed truth.", "SCORE_EXAMPLES"),
    },
    "AirZoo-Mini, which needs no data": {
        "demo": ("demo:demo", "Run a plain method on every track, and print the tables."),
        "mini": ("mini:app", "Make the world of AirZoo-Mini, and photos of it."),
    },
}
_PLACES = {name: place for panel in _COMMANDS.values() for name, place in panel.items()}

# Options that library code names, and that not every command has which calls it.
_SHARED = {
    "--data", "--depth", "--engine", "--force", "--image-size", "--jobs", "--max-memory",
    "--names", "--out", "--protocol", "--reader", "--resume",
}  # fmt: skip
_OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
_OTHER_CALL = re.compile(r"`[^`]*`(?: with --\w+)?")
_OR = ", or "


class _Main(LightGroup):
    """All commands, in panels; the help imports none of them."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self._built: dict[str, Any] = {}

    def list_commands(self, ctx: Any) -> list[str]:
        return [*_PLACES, *self.commands]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command."""
        if cmd_name in _PLACES and cmd_name not in self._built:
            self._built[cmd_name] = _build_command(cmd_name, *_PLACES[cmd_name])
        return self._built.get(cmd_name) or super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands panel by panel."""
        for panel, places in _COMMANDS.items():
            with formatter.section(panel):
                formatter.write_dl([(name, place[1]) for name, place in places.items()])


def _build_command(name: str, place: str, _: str, examples: str = "EXAMPLES") -> Any:
    home, attribute = place.split(":")
    module = import_module(f"airzoo_bench.cli.{home}")
    found = getattr(module, attribute)
    if isinstance(found, typer.Typer):
        group = typer.main.get_group(found)
        group.name = name
        return group
    app = typer.Typer(add_completion=False)
    panels = in_panels(getattr(module, "PANELS", {}))
    app.command(name, cls=panels, epilog=getattr(module, examples))(found)
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


def options_of(group: Any, words: Sequence[str] | Iterator[str]) -> set[str]:
    """Return the options of the command that words of a command line name."""
    rest = iter(words)
    found = group.get_command(None, next(rest, "")) if hasattr(group, "get_command") else None
    if found is not None:
        return options_of(found, rest)
    return {name for one in group.params for name in one.opts}


def own_ways(fix: str | None, options: set[str]) -> str | None:
    """Leave out ways to mend a fault, with ", or " between, by options that a command lacks.

    Library code is called by many commands, and says how to mend a fault in all of them: "raise
    --max-memory, or sample the mesh".
    """
    foreign = _SHARED - options
    ways = [
        way
        for way in (fix or "").split(_OR)
        if foreign.isdisjoint(_OPTION.findall(_OTHER_CALL.sub("", way)))
    ]
    return _OR.join(ways) or None


def _near_path(error: UserError) -> str:
    """Offer the name next to a path that is not there and is most like it."""
    path = Path(re.sub(r"^--\S+ ", "", error.where or ""))
    if not error.what.startswith("no such") or path.exists() or not path.parent.is_dir():
        return ""
    from airzoo_bench.core.validation import near_names

    names = [entry.name for entry in islice(path.parent.iterdir(), _MOST_NEIGHBOURS)]
    near = near_names(path.name, names, 1)
    return f"\n  nearest:  {path.parent / near[0]}" if near else ""
