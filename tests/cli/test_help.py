"""Help that is alike for all commands: where examples stand, what options are called for short."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from airzoo_bench.cli.built import BuiltGroup
from airzoo_bench.cli.main import app
from tests.support import run_main

SHORT = {"--out": "-o", "--format": "-f", "--jobs": "-j"}


def commands(group: object, *above: str) -> Iterator[tuple[str, TyperCommand]]:
    assert isinstance(group, TyperGroup)
    for name, command in group.commands.items():
        if isinstance(command, BuiltGroup):
            for built in command.list_commands(None):
                yield f"{name} {built}", command.get_command(None, built)
        elif isinstance(command, TyperGroup):
            yield from commands(command, *above, name)
        elif isinstance(command, TyperCommand):
            yield " ".join([*above, name]), command


COMMANDS = dict(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("name", COMMANDS)
def test_options_have_one_short_form(name: str) -> None:
    for option in COMMANDS[name].params:
        for long in SHORT.keys() & set(option.opts):
            assert SHORT[long] in option.opts, (name, long)


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_stand_at_the_end(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*name.split(), "--help") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"Example: airzoo-bench {name}" in said.rpartition("╯")[2]
    assert "Example:" not in said.rpartition("╯")[0]


def shown_options(command: TyperCommand) -> list[Any]:
    return [p for p in command.params if isinstance(p, TyperOption) and p.name != "help"]


@pytest.mark.parametrize("name", COMMANDS)
def test_many_options_stand_in_panels(name: str) -> None:
    options = shown_options(COMMANDS[name])
    panels = {option.rich_help_panel for option in options}
    if len(options) > 10:
        assert None not in panels, [o.name for o in options if o.rich_help_panel is None]
        assert len(panels) > 2


@pytest.mark.parametrize("name", COMMANDS)
def test_arguments_stand_before_options(name: str) -> None:
    params = COMMANDS[name].params
    arguments = [one for one in params if one.param_type_name == "argument"]
    assert params[: len(arguments)] == arguments or params[1 : len(arguments) + 1] == arguments
    assert all(getattr(one, "rich_help_panel", None) is None for one in arguments)


def test_panels_of_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("table", "--help") == 0
    said = capsys.readouterr().out
    titles = ["Rows and columns", "Statistics", "Published numbers", "Output", "LaTeX"]
    places = [said.index(f"─ {title} ─") for title in titles]
    assert said.index("--fit") > places[4]
    assert places[1] < said.index("--second") < places[2]


def test_what_a_picture_needs_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert run_main("plot", "recall", "--help") == 0
    said = capsys.readouterr().out
    assert [line for line in said.splitlines() if "RESULTS" in line and "required" in line]


def test_help_of_published_data_says_where_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        app(["prepare", "uav-visloc", "--help"])
    said = capsys.readouterr().out
    assert "https://github.com/IntelliSensing/UAV-VisLoc" in said
    assert "Licence:" in said


@pytest.mark.parametrize("name", COMMANDS)
def test_no_word_is_broken_in_80_columns(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert run_main(*name.split(), "--help") == 0
    shown = capsys.readouterr().out
    for option in shown_options(COMMANDS[name]):
        choices = [str(getattr(one, "value", one)) for one in option.type_descriptor.choices or ()]
        choices = choices if option.metavar is None else re.findall(r"[^][|<>\s]+", option.metavar)
        words = [*option.opts, *option.secondary_opts, *choices]
        assert [word for word in words if word not in shown] == []
