"""Entry point: exit codes and all commands.

0 done; 1 a check found something wrong; 2 the input is wrong; 70 a bug of the suite; 130 stopped.
"""

from __future__ import annotations

import io
import re
import sys
import traceback
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperOption

from airzoo_bench.cli import (
    audit,
    baseline,
    breakdown,
    check,
    check_geometry,
    compare,
    demo,
    download,
    evaluate,
    leaderboard,
    manifest,
    mini,
    plot,
    prepare,
    protocols,
    readers,
    report,
    seal,
    submit,
    table,
    template,
)
from airzoo_bench.cli.common import LightGroup, in_panels, say
from airzoo_bench.cli.remedies import options_of, own_ways
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.version import __version__

__all__ = ["app", "main"]

_INPUT_IS_WRONG = 2
_BUG = 70
_MOST_NEIGHBOURS = 10_000

SCORE, RESULTS, DATA = "Score", "Results", "Data"
CHECKS, MINI = "Checks", "AirZoo-Mini, which needs no data"
LEADERBOARD = "Leaderboard"
_PANELS = (SCORE, RESULTS, DATA, CHECKS, LEADERBOARD, MINI)
_FIRST = ("eval", "table", "prepare", "submit", "leaderboard")


class _Main(LightGroup):
    def list_commands(self, ctx: Any) -> list[str]:
        """Name the commands by panel, in each the ones that most come for first."""
        return sorted(super().list_commands(ctx), key=self._place)

    def _place(self, name: str) -> tuple[int, bool]:
        panel = getattr(self.commands[name], "rich_help_panel", MINI)
        return _PANELS.index(panel), name not in _FIRST


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
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(evaluate.app, name="eval", rich_help_panel=SCORE)
app.command("check", epilog=check.EXAMPLES, rich_help_panel=SCORE)(check.check)
app.command("readers", epilog=readers.EXAMPLES, rich_help_panel=SCORE)(readers.readers)
app.command("template", epilog=template.EXAMPLES, rich_help_panel=SCORE)(template.template)
app.add_typer(baseline.app, name="baseline", rich_help_panel=SCORE)
app.command("table", cls=in_panels(table.PANELS), epilog=table.EXAMPLES, rich_help_panel=RESULTS)(
    table.table
)
app.command(
    "compare", cls=in_panels(compare.PANELS), epilog=compare.EXAMPLES, rich_help_panel=RESULTS
)(compare.compare)
app.command("breakdown", epilog=breakdown.EXAMPLES, rich_help_panel=RESULTS)(breakdown.breakdown)
app.add_typer(plot.app, name="plot", rich_help_panel=RESULTS)
app.command("report", epilog=report.EXAMPLES, rich_help_panel=RESULTS)(report.report)
app.command("download", epilog=download.EXAMPLES, rich_help_panel=DATA)(download.download)
app.add_typer(prepare.app, name="prepare", rich_help_panel=DATA)
app.command("manifest", epilog=manifest.EXAMPLES, rich_help_panel=DATA)(manifest.manifest)
app.command("protocols", epilog=protocols.EXAMPLES, rich_help_panel=DATA)(protocols.protocols)
app.command("audit", epilog=audit.EXAMPLES, rich_help_panel=CHECKS)(audit.audit)
app.command(
    "check-geometry",
    cls=in_panels(check_geometry.GEOMETRY_PANELS),
    epilog=check_geometry.GEOMETRY_EXAMPLES,
    rich_help_panel=CHECKS,
)(check_geometry.check_geometry)
app.command("check-split", epilog=check_geometry.SPLIT_EXAMPLES, rich_help_panel=CHECKS)(
    check_geometry.check_split
)
app.command(
    "submit", cls=in_panels(submit.PANELS), epilog=submit.EXAMPLES, rich_help_panel=LEADERBOARD
)(submit.submit)
app.add_typer(submit.app, name="submission", rich_help_panel=LEADERBOARD)
app.add_typer(leaderboard.app, name="leaderboard", rich_help_panel=LEADERBOARD)
for _name, _command, _examples in (
    ("seal", seal.seal, seal.SEAL_EXAMPLES),
    ("seal-score", seal.seal_score, seal.SCORE_EXAMPLES),
):
    app.command(_name, epilog=_examples, rich_help_panel=LEADERBOARD)(_command)
app.command("demo", epilog=demo.EXAMPLES, rich_help_panel=MINI)(demo.demo)
app.add_typer(mini.app, name="mini", rich_help_panel=MINI)


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
    _allow_every_letter()
    try:
        app(standalone_mode=True)
    except UserError as error:
        _refuse(error)
    except (OSError, MemoryError) as error:
        _refuse(_fault_of_the_machine(error))
    except Exception:  # noqa: BLE001 - the one place where a bug is reported as a bug
        traceback.print_exc()
        say("airzoo-bench: this is a bug of the suite, not of your input: please report it")
        sys.exit(_BUG)


def _refuse(error: UserError) -> NoReturn:
    """Say what is wrong, and only such ways to mend it as the command has."""
    error.fix = own_ways(error.fix, options_of(typer.main.get_command(app), sys.argv[1:]))
    say(f"airzoo-bench: {error}{_near_path(error)}")
    sys.exit(_INPUT_IS_WRONG)


def _allow_every_letter() -> None:
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Not every terminal or pipe has a code for every letter of a name.
            stream.reconfigure(errors="backslashreplace")


def _near_path(error: UserError) -> str:
    """Offer the name next to a path that is not there and is most like it."""
    path = Path(re.sub(r"^--\S+ ", "", error.where or ""))
    if not error.what.startswith("no such") or path.exists() or not path.parent.is_dir():
        return ""
    from airzoo_bench.core.validation import near_names

    names = [entry.name for entry in islice(path.parent.iterdir(), _MOST_NEIGHBOURS)]
    near = near_names(path.name, names, 1)
    return f"\n  nearest:  {path.parent / near[0]}" if near else ""


def _fault_of_the_machine(error: OSError | MemoryError) -> UserError:
    if isinstance(error, OSError):
        where = str(error.filename or "a file")[:200]
        return UserError(error.strerror or str(error), where=where)
    return UserError(
        f"not enough memory ({error})",
        fix="lower --max-memory, or lower --jobs, or run it on a machine with more memory",
    )
