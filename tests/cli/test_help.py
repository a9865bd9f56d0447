"""Help that is alike for all commands, loads nothing heavy, and how many of them there are."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from airzoo_bench.cli.main import app
from tests.support import HANGS_S, run_main

MOST_OPTIONS = 170
COMMON = ("--all", "--data", "--engine", "--format", "--jobs", "--untrusted")
SHORT = {"--out": "-o", "--format": "-f", "--jobs": "-j"}
# These count once, with the options of all that they are for.
ONCE = ("eval", "prepare", "plot", "baseline")


def commands(group: Any, *above: str) -> Iterator[tuple[str, TyperCommand]]:
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if isinstance(command, TyperGroup):
            yield from commands(command, *above, name)
        else:
            yield " ".join([*above, name]), command


COMMANDS = dict(commands(typer.main.get_command(app)))


def shown_options(command: TyperCommand) -> list[Any]:
    return [p for p in command.params if isinstance(p, TyperOption) and p.name != "help"]


def test_commands_and_options_are_few() -> None:
    firsts = {name: name.partition(" ")[0] for name in COMMANDS}
    of_commands = {first if first in ONCE else name for name, first in firsts.items()}
    assert len(of_commands) <= 30
    options = {
        (firsts[name], option.name)
        for name, command in COMMANDS.items()
        for option in shown_options(command)
    }
    assert len(options) <= MOST_OPTIONS


def test_a_common_option_means_the_same_everywhere() -> None:
    said: dict[str, set[str]] = {}
    for command in COMMANDS.values():
        for option in shown_options(command):
            said.setdefault(option.opts[0], set()).add(option.help)
            for long in SHORT.keys() & set(option.opts):
                assert SHORT[long] in option.opts
    assert {name: len(said[name]) for name in COMMON} == dict.fromkeys(COMMON, 1)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_80_columns(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert run_main(*name.split(), "--help") == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    command = COMMANDS[name]
    said = [str(command.help), *(str(option.help) for option in shown_options(command))]
    # Whatever the lines, every word is whole.
    words = {word for text in said for word in text.replace("\b", "").split()}
    words |= {flag for one in shown_options(command) for flag in (*one.opts, *one.secondary_opts)}
    assert words <= set(re.split(r"[\s,]+", shown)) | set(re.split(r"[\s/]+", shown)) | set(
        shown.split()
    )
    assert f"Example: airzoo-bench {name}" in shown
    titles = re.findall(r"^(\S.*):$", shown, re.MULTILINE)
    assert "For scale" not in titles[:-1]
    assert len(shown_options(command)) <= 10 or len(titles) > 2


HEAVY = ("numpy", "pandas", "scipy", "matplotlib", "rasterio", "pyproj", "faiss", "pydantic")
CALLS = [
    *("--help", "--version", "table --help", "check -h", "plot -h"),
    *("eval --help", "baseline --help", "prepare --help", "mini render -h"),
]
RUN = f"""
import sys
from airzoo_bench.cli.main import main
for call in {CALLS!r}:
    sys.argv = ["airzoo-bench", *call.split()]
    try:
        main()
    except SystemExit as done:
        assert not done.code, (call, done.code)
    loaded = {{name.partition(".")[0] for name in sys.modules}}
    assert loaded.isdisjoint({HEAVY!r}), (call, loaded.intersection({HEAVY!r}))
"""


def test_help_loads_nothing_heavy() -> None:
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANGS_S)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage:") == len(CALLS) - 1
