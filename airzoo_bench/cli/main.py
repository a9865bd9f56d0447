"""Entry point: all commands, each imported when it is chosen, and exit codes.

0 done; 1 a check found something wrong; 2 the input is wrong; 70 a bug of the suite; 130 stopped.
"""

from __future__ import annotations

import io
import re
import sys
import textwrap
import traceback
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from airzoo_bench.cli.common import LightGroup, examples, in_panels, say
from airzoo_bench.core.errors import UserError

_INPUT_IS_WRONG = 2
_BUG = 70
_MOST_NEIGHBOURS = 10_000

# By panel and name: a function or a group of commands in a module of this folder, its help, and
# examples.
_COMMANDS: dict[str, dict[str, tuple[str, ...]]] = {
    "Score": {
        "eval": ("evaluate:app", "Score predictions and print the per-scene table."),
        "check": (
            *("predictions:check", "Find errors of predictions.", "check preds.npz"),
            "check logs/2026-01-01_12-00-00 --protocol airzoo-mini-retrieval",
        ),
        "readers": (
            *("predictions:readers", "List the readers of methods' own files.", "readers vpr"),
            "eval retrieval logs/2026-01-01_12-00-00 --protocol uav-visloc-retrieval",
        ),
        "template": (
            *("predictions:template", "Write an example prediction."),
            "template airzoo-mini-retrieval --out preds.npz",
        ),
        "baseline": ("baseline:app", "Run a plain method that needs no weights."),
    },
    "Results": {
        "table": (
            *("table:table", "Print results as a table: terminal, LaTeX, CSV ..."),
            "table results/*/result.json --format latex",
            "table */result.json --layout scenes --published -f latex",
            "table uav-visloc-retrieval --published --layout scenes",
        ),
        "compare": (
            *("results:compare", "Compare methods query by query, with tests."),
            "compare results/mine/result.json results/theirs/result.json",
            "compare results/*/result.json --method Mine",
        ),
        "breakdown": (
            *("results:breakdown", "Print scores by weather, altitude ..."),
            "breakdown results/mine/result.json --by weather",
            "breakdown results/*/result.json --by altitude_m --bins 50,100 --score R@1",
        ),
        "plot": ("plot:app", "Draw results as pictures."),
        "report": (
            *("results:report", "Write a report: one HTML file with everything."),
            "report results/*/result.json -o report.html",
        ),
    },
    "Data": {
        "prepare": ("prepare:app", "Make a benchmark folder out of data."),
        "download": (
            *("data:download", "Fetch a published benchmark, or its links.", "download NAME"),
            "download NAME --to /data/NAME --scene 01",
        ),
        "manifest": (
            *("data:manifest", "Fill in benchmark.toml of your own folder.", "manifest mine"),
        ),
        "protocols": (
            *("data:protocols", "List all protocols, or print one."),
            "protocols uav-visloc-retrieval",
        ),
    },
    "Checks": {
        "audit": (
            *("checks:audit", "Check a published table against arithmetic.", "audit table.csv"),
            "audit table.csv --counts City=161,Rural=190 --format markdown",
        ),
        "check-geometry": (
            *("checks:check_geometry", "Check frames and depth of a dataset."),
            "check-geometry airzoo-mini --format json",
        ),
        "check-split": (
            *("checks:check_split", "Check that two sets see no common ground."),
            "check-split training-set airzoo-mini --out overlaps.csv",
        ),
    },
    "Leaderboard": {
        "submit": (
            *("submit:submit", "Submit predictions to a board.", "submit preds.npz --method SALAD"),
            "submit preds.npz --url https://zenodo.org/records/1/files/preds.npz --set "
            "code=https://github.com/serizba/salad",
        ),
        "submission": ("submit:app", "Check a submission before it is sent."),
        "leaderboard": ("leaderboard:app", "A board of your own: files, CI, pages."),
        "seal": (
            *("seal:seal", "Split a benchmark from its truth."),
            "seal mine --out public/mine --archive public/mine.age --to age1...",
        ),
    },
    "AirZoo-Mini, which needs no data": {
        "demo": ("baseline:demo", "Run a plain method on every track of a demo.", "demo"),
        "mini": ("mini:app", "Take photos of the world of AirZoo-Mini."),
    },
}
_PLACES = {name: place for panel in _COMMANDS.values() for name, place in panel.items()}

typer.core.HAS_RICH = False  # which takes as long to import as all else
# Lines of the help end between words, never within --image-size.
textwrap.TextWrapper.wordsep_re = textwrap.TextWrapper.wordsep_simple_re


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


def _build_command(name: str, place: str, _: str, *calls: str) -> Any:
    home, attribute = place.split(":")
    module = import_module(f"airzoo_bench.cli.{home}")
    found = getattr(module, attribute)
    if isinstance(found, typer.Typer):
        group = typer.main.get_group(found)
        group.name = name
        return group
    app = typer.Typer(add_completion=False)
    panels = in_panels(getattr(module, "PANELS", {}))
    app.command(name, cls=panels, epilog=examples(*calls))(found)
    return typer.main.get_command(app)


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
        fix = "lower --max-memory or --jobs, or run it on a machine with more memory"
        _refuse(UserError(f"not enough memory ({error})", fix=fix))
    except OSError as error:
        where = str(error.filename or "a file")[:200]
        _refuse(UserError(error.strerror or str(error), where=where))
    except Exception:  # noqa: BLE001 - the one place where a bug is reported as a bug
        traceback.print_exc()
        say("airzoo-bench: this is a bug of the suite, not of your input: please report it")
        sys.exit(_BUG)


def _refuse(error: UserError) -> NoReturn:
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
