"""Options, help and places of several commands, and what they print."""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO, TypeAlias, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from airzoo_bench.cli.progress import report_progress
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import data_location, data_root
from airzoo_bench.storage.urls import local_path, url_of

if TYPE_CHECKING:
    from airzoo_bench.tables.model import Table

T = TypeVar("T")
Text: TypeAlias = str | None
Texts: TypeAlias = list[str] | None
File: TypeAlias = Path | None

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
ROWS, _SCALE = "Rows and columns", "For scale"
_FEW = 10  # options that need no panels
_display: list[Any] = []
_WRONG_CALL: Any = typer.BadParameter.__base__  # UsageError, which typer does not export


class Format(StrEnum):
    """The forms of a printed table."""

    TERMINAL = "terminal"
    LATEX = "latex"
    CSV = "csv"
    MARKDOWN = "markdown"
    HTML = "html"
    JSON = "json"


def option(help_: str, *flags: str, panel: str | None = None, **more: Any) -> Any:
    """Describe an option, in a panel of the help of commands that have many."""
    return typer.Option(*flags, help=help_, rich_help_panel=panel, **more)


FormatOption = Annotated[
    Format, option("How to print the table.", "--format", "-f", panel="Output")
]
ProtocolOption = Annotated[
    Text, option("Name or .toml file (default: what the file itself names).", panel="Input")
]
DataOption = Annotated[
    Text,
    option(
        "The benchmark folder, the folder that holds it, or the URL of either, such as "
        "s3://bucket/name (default: $AIRZOO_BENCH_DATA, else a cache folder).",
        *("--data",),
        metavar="PATH|URL",
        panel="Input",
    ),
]
ReaderOption = Annotated[
    Text,
    option("One of `airzoo-bench readers` (default: the one that knows the files).", panel="Input"),
]
NamesOption = Annotated[
    File, option("A file with a photo's name a line, in the method's order.", panel="Input")
]
ImageSizeOption = Annotated[
    Text,
    option(
        "Size of the matcher's pictures, for files that do not state it, such as SuperGlue's.",
        metavar="WxH",
        panel="Input",
    ),
]
SceneOption = Annotated[Text, option("This scene only, by id or title.")]
ScoresOption = Annotated[
    Texts, option("Key or title, repeatable (default: the paper's scores).", "--score", panel=ROWS)
]
AllOption = Annotated[bool, option("Print every score, not only the paper's.", "--all", panel=ROWS)]
JobsOption = Annotated[
    int | None,
    option(
        "Threads or processes (default: one or two).", "--jobs", "-j", panel=_SCALE, min=1, max=1024
    ),
]
EngineOption = Annotated[
    str,
    option(
        "Where to compute, with the same result: here; on --jobs Dask workers of this machine "
        "(extra `dask`); or by a Dask scheduler, such as tcp://10.0.0.5:8786, whose workers must "
        "see all files under the same paths.",
        metavar="local|dask|ADDRESS",
        panel=_SCALE,
    ),
]
MemoryOption = Annotated[
    str, option("Memory for a file, or for a Dask worker, such as 512M or 4G.", panel=_SCALE)
]
UntrustedOption = Annotated[
    bool,
    option(
        "Read a stranger's predictions in a child process under limits of memory, processor time "
        "and clock. These are limits, not isolation. Linux only.",
        "--untrusted",
        panel=_SCALE,
    ),
]
ResultsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="RESULTS", help="One or more result.json, or their folders: paths or URLs."
    ),
]


# --- help ---


class LightGroup(TyperGroup):
    """A group of commands that shows its help without Pydantic, and names the near command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments; typer's own flags have no default, and its types would be made."""
        for one in self.get_params(ctx):
            if isinstance(one, TyperOption) and one.is_flag and one.default is None:
                one.default = False
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command of a name; refuse an unknown one."""
        if not args[0].startswith("-"):
            check_choice(ctx.command_path, args[0], self.list_commands(ctx))
        return super().resolve_command(ctx, args)


class PanelCommand(TyperCommand):
    """A command with its options in panels, those for scale at the end."""

    panels: Mapping[str, str] = {}  # of options that name none

    def make_context(self, *given: Any, **more: Any) -> Any:
        """Read the arguments; say what is wrong with them as other refusals do."""
        try:
            return super().make_context(*given, **more)
        except _WRONG_CALL as error:
            said = error.format_message().replace("Value error, ", "").rstrip(".")
            if found := re.search(r"'([^']*)' is not one of (.*)", said):
                from airzoo_bench.core.validation import nearest

                said += nearest(found[1], re.findall("'([^']*)'", found[2]), 1)
            name = error.ctx.command_path if error.ctx else "airzoo-bench"
            raise UsageError(said, fix=f"`{name} --help` lists the options") from None

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """List arguments and options."""
        shown: dict[str, list[Any]] = {"Arguments": []}
        several = sum(one.param_type_name == "option" for one in self.params) > _FEW
        for one in self.get_params(ctx):
            title = getattr(one, "rich_help_panel", None) or self.panels.get(str(one.name))
            if one.param_type_name == "argument":
                title = "Arguments"
            elif title != _SCALE and not (several and title):
                title = "Options"
            record = None if several and one.name == "help" else one.get_help_record(ctx)
            if record:
                shown.setdefault(title, []).append(record)
        shown[_SCALE] = shown.pop(_SCALE, [])
        for title, records in shown.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def check_choice(command: str, given: str, names: Sequence[str]) -> None:
    """Refuse a word that names none of the choices, such as a path in its place."""
    if given in names:
        return
    from airzoo_bench.core.validation import nearest

    near = nearest(given, list(names), 1)
    fix = f"{command} {names[0]} {given}" if Path(given).suffix or Path(given).exists() else None
    expected = f"what `{command} --help` lists" if near else "one of " + ", ".join(names)
    raise UsageError(f"{command} knows no {given!r}{near}", expected=expected, fix=fix)


def examples(*calls: str) -> str:
    """Return the examples at the end of a command's help."""
    return "\n\n".join(f"Example: airzoo-bench {call}" for call in calls)


# --- places and sizes ---


def resolve_data(data: str | None) -> Path:
    """Return the named folder, else the configured data root; URLs are copied."""
    if url_of(data_location() if data is None else data) is not None:
        from airzoo_bench.benchmark.folder import data_here

        with working("fetching the benchmark"):
            return data_here(data)
    if data is not None and not Path(data).is_dir():
        expected = "a benchmark folder, as `airzoo-bench prepare` makes it, or a folder of some"
        raise UsageError("no such folder", where=f"--data {data}", expected=expected)
    return data_root() if data is None else Path(data)


def predictions_here(location: str) -> Path:
    """Return predictions as a path of this machine; URLs are copied."""
    if url_of(location) is None:
        return Path(location)
    with working("fetching the predictions"):
        return local_path(location)


def with_data(data: str | Path | None) -> str:
    """Return the ``--data`` option for the command that is suggested next."""
    return "" if data is None else f" --data {data}"


def memory_bytes(text: str) -> int:
    """Turn ``512M`` into bytes."""
    found = re.fullmatch(r"(\d+)([KMGT]?)B?", text.strip().upper())
    if not found or int(found[1]) == 0:
        raise UsageError(f"--max-memory {text!r} is not a size", expected="such as 512M or 4G")
    return int(found[1]) * _UNITS[found[2]]


# --- printing ---


def printable(text: str) -> str:
    """Escape control characters: ids in a message come from strangers."""
    return "".join(c if c.isprintable() or c == "\n" else f"\\x{ord(c):02x}" for c in text)


def say(message: str) -> None:
    """Print a message on stderr, so that a pipe stays clean."""
    _write(printable(message) + "\n", sys.stderr)


def echo(text: str, form: Format = Format.TERMINAL) -> None:
    """Write text to stdout; the content of a file is UTF-8 whatever the terminal's encoding."""
    if form is not Format.TERMINAL and isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(encoding="utf-8", errors="backslashreplace")
    _write(text, sys.stdout)


def _write(text: str, stream: TextIO) -> None:
    try:
        stream.write(text)
        stream.flush()
    except BrokenPipeError:  # the reader of a pipe has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def show(table: Table, form: Format) -> None:
    """Print a table on stdout, as wide as the terminal; the notes of CSV go to stderr."""
    from airzoo_bench.tables.render import render

    width = shutil.get_terminal_size((80, 24)).columns
    echo(render(table, form.value, width=width, styled=sys.stdout.isatty()), form)
    if form is Format.CSV:
        for note in table.notes:
            say(note)


def show_rows(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], form: Format
) -> None:
    """Print texts and whole numbers as a table."""
    from airzoo_bench.tables.model import Cell, Column, Row, Table

    cells = tuple(Row(tuple(map(Cell, row))) for row in rows)
    show(Table(title, tuple(map(Column, columns)), cells), form)


def progress(items: Iterable[T], label: str, total: int) -> Generator[T]:
    """Yield the items and show the time left on stderr: a bar, or lines without a terminal.

    Work may consist of work: all bars are in one display.
    """
    if not sys.stderr.isatty():
        yield from report_progress(items, label, total, say=say)
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress

    is_first = not _display
    if is_first:
        _display.append(Progress(console=Console(stderr=True), transient=True))
        _display[0].start()
    bars = _display[0]
    known = total if total > 1 else None  # one piece of work is never half done: it pulses
    row = bars.add_task(escape(printable(label)), total=known)
    try:
        yield from bars.track(items, total=known, task_id=row)
    finally:
        bars.remove_task(row)
        if is_first:
            bars.stop()
            _display.clear()


@contextmanager
def working(label: str) -> Iterator[None]:
    """Show on stderr that something is under way; without a terminal, a line if it takes long."""
    with closing(progress((None,), label, 1)) as step:
        next(step)
        yield
