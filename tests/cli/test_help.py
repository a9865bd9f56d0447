"""Help that is alike for all commands: where examples stand, what options are called for short."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from airzoo_bench.cli.main import app
from tests.support import run_main

MOST_OPTIONS = 229
COMMON = ("--all", "--data", "--engine", "--format", "--jobs", "--untrusted")
SCALE = ("jobs", "max_memory", "untrusted", "engine", "resume")
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


def test_commands_and_options_are_few() -> None:
    options: dict[str, set[str]] = {}
    for name, command in COMMANDS.items():
        first = name.partition(" ")[0]
        found = options.setdefault(first if first in ONCE else name, set())
        found |= {str(option.name) for option in shown_options(command)}
    assert len(options) <= 30
    assert sum(map(len, options.values())) <= MOST_OPTIONS


def test_a_common_option_means_the_same_everywhere() -> None:
    said: dict[str, set[str]] = {}
    for command in COMMANDS.values():
        for option in shown_options(command):
            if option.opts[0] in COMMON:
                said.setdefault(option.opts[0], set()).add(option.help)
    assert {name: len(helps) for name, helps in said.items()} == dict.fromkeys(COMMON, 1)


@pytest.mark.parametrize("name", COMMANDS)
def test_what_is_for_scale_stands_in_the_last_panel(name: str) -> None:
    panels = [getattr(one, "rich_help_panel", None) for one in COMMANDS[name].params]
    used = [one.name for one in COMMANDS[name].params if one.name in SCALE]
    if len(used) > 1 and name.partition(" ")[0] not in ("leaderboard", "submission"):
        assert panels[-len(used) :] == ["For scale"] * len(used)


@pytest.mark.parametrize(
    ("call", "near"),
    [
        ("evl retrieval", "did you mean 'eval'"),
        ("eval retreival p.npz", "did you mean 'retrieval'"),
        ("plot recal r.json", "did you mean 'recall'"),
        ("prepare UAV_VisLoc", "did you mean 'uav-visloc'"),
        ("leaderboard biuld", "did you mean 'build'"),
        ("table --layuot scenes", "--layout"),
        ("eval p.npz", "eval retrieval p.npz"),
    ],
)
def test_a_mistyped_name_is_answered_with_the_near_one(
    call: str, near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main(*call.split()) == 2
    assert near in capsys.readouterr().err.replace("Did", "did")


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
