"""Options, help, printing and progress of several commands."""

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
from typing import TYPE_CHECKING, Annotated, Any, TextIO, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.progress import report_progress

if TYPE_CHECKING:
    from airzoo_bench.tables.model import Table

T = TypeVar("T")

_OF_FILES = (".npz", ".npy", ".parquet", ".csv", ".json", ".h5", ".txt", ".zip")
_SCALE = ("jobs", "max_memory", "untrusted", "engine", "resume")
_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


class Format(StrEnum):
    """The forms of a printed table."""

    TERMINAL = "terminal"
    LATEX = "latex"
    CSV = "csv"
    MARKDOWN = "markdown"
    HTML = "html"
    JSON = "json"


FormatOption = Annotated[Format, typer.Option("--format", "-f", help="How to print the table.")]
ProtocolOption = Annotated[
    str | None,
    typer.Option("--protocol", help="Name or .toml file (default: what the file itself names)."),
]
MemoryOption = Annotated[
    str,
    typer.Option(
        "--max-memory",
        help="Memory that a file may take, such as 512M or 4G; also the limit of a Dask worker.",
    ),
]
ReaderOption = Annotated[
    str | None,
    typer.Option(
        "--reader",
        help="Reader of a method's own files (default: found by their content); "
        "`airzoo-bench readers` lists all.",
    ),
]
NamesOption = Annotated[
    Path | None,
    typer.Option(
        "--names",
        help="A list of images, one a line, in the method's order, for files that do not name "
        "them.",
    ),
]
UntrustedOption = Annotated[
    bool,
    typer.Option(
        "--untrusted",
        help="Read a stranger's predictions in a child process under limits of memory, processor "
        "time and clock. These are limits, not isolation. Linux only.",
    ),
]
ImageSizeOption = Annotated[
    str | None,
    typer.Option(
        "--image-size",
        metavar="WxH",
        help="Size of the matcher's pictures, such as 640x480, for files that do not state it, "
        "such as SuperGlue's.",
    ),
]
SceneOption = Annotated[
    str | None, typer.Option("--scene", help="This scene only, by id or title.")
]
ScoresOption = Annotated[
    list[str] | None,
    typer.Option("--score", help="Key or title, repeatable (default: the paper's scores)."),
]
AllOption = Annotated[bool, typer.Option("--all", help="Print every score, not only the paper's.")]
EngineOption = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="local|dask|ADDRESS",
        help="Where to compute, with the same result: here; on --jobs Dask workers of this "
        "machine (extra `dask`); or by a Dask scheduler, such as tcp://10.0.0.5:8786, whose "
        "workers must see all files under the same paths.",
    ),
]
ResumeOption = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Keep each scored scene, and continue from scenes kept by an earlier run with this "
        "--out and --resume.",
    ),
]
JobsOption = Annotated[
    int, typer.Option("--jobs", "-j", min=1, max=1024, help="Threads or processes to work with.")
]


class LightGroup(TyperGroup):
    """A group of commands that shows its help without Pydantic, and names the near command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments; typer's own flags have no default, and its types would be made."""
        for one in self.get_params(ctx):
            if isinstance(one, TyperOption) and one.is_flag and one.default is None:
                one.default = False
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command of a name; refuse an unknown one, or a path in its place."""
        names, given = self.list_commands(ctx), args[0]
        if given in names or given.startswith("-"):
            return super().resolve_command(ctx, args)
        from airzoo_bench.core.validation import nearest

        is_path = Path(given).exists() or Path(given).suffix in _OF_FILES
        raise UsageError(
            f"{ctx.command_path} knows no {given!r}{nearest(given, names, 1)}",
            expected="one of " + ", ".join(names),
            fix=f"{ctx.command_path} {names[0]} {given}" if is_path else None,
        )


def examples(*calls: str) -> str:
    """Return the examples at the end of a command's help."""
    return "\n\n".join(f"Example: airzoo-bench {call}" for call in calls)


def in_panels(panels: Mapping[str, Sequence[str]], rest: str = "Options") -> type[TyperCommand]:
    """Return a command class whose help shows parameters under titles; others under `rest`.

    What is for scale comes last.
    """
    titles = {name: title for title, names in panels.items() for name in names}
    titles |= dict.fromkeys(_SCALE, "For scale")

    class Grouped(TyperCommand):
        def format_options(self, ctx: Any, formatter: Any) -> None:
            shown: dict[str, list[Any]] = {
                title: [] for title in ("Arguments", *panels, rest, "For scale")
            }
            for one in self.get_params(ctx):
                if panels and one.name == "help":
                    continue
                is_argument = one.param_type_name == "argument"
                title = "Arguments" if is_argument else titles.get(str(one.name), rest)
                shown[title] += [record] if (record := one.get_help_record(ctx)) else []
            for title, records in shown.items():
                if records:
                    with formatter.section(title):
                        formatter.write_dl(records)

    return Grouped


def memory_bytes(text: str) -> int:
    """Turn ``512M`` into bytes."""
    found = re.fullmatch(r"(\d+)([KMGT]?)B?", text.strip().upper())
    if not found or int(found[1]) == 0:
        raise UsageError(f"--max-memory {text!r} is not a size", expected="such as 512M or 4G")
    return int(found[1]) * _UNITS[found[2]]


def printable(text: str) -> str:
    """Escape control characters: ids in a message come from strangers."""
    return "".join(c if c.isprintable() or c == "\n" else f"\\x{ord(c):02x}" for c in text)


def say(message: str) -> None:
    """Print a message on stderr, so that a pipe stays clean."""
    _write(printable(message) + "\n", sys.stderr)


def put(text: str, form: Format = Format.TERMINAL) -> None:
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
    put(render(table, form.value, width=width, styled=sys.stdout.isatty()), form)
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
    """Yield the items and show the time left on stderr: a bar, or lines without a terminal."""
    if not sys.stderr.isatty():
        yield from report_progress(items, label, total, say=say)
        return
    from airzoo_bench.cli.bars import bar

    yield from bar(items, printable(label), total)


@contextmanager
def working(label: str) -> Iterator[None]:
    """Show on stderr that something is under way; without a terminal, a line if it takes long."""
    with closing(progress((None,), label, 1)) as step:
        next(step)
        yield
