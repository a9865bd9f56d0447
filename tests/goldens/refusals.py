"""Bad inputs of ``refusals.txt``: sound ones that a recipe spoils; a command refuses or notes it.

A line is ``name | recipe | command | exit code and names`` (recipes.py). Names are what the message
must hold, however it is worded or wrapped.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.goldens.recipes import spoil, steps
from tests.goldens.run import HERE, run, table


@dataclass(frozen=True)
class Refusal:
    """A bad input: its section, name, recipe, command, exit code and the names in the message."""

    inputs: str
    name: str
    recipe: list[str]
    command: str
    code: int
    names: list[str]


def refusals() -> list[Refusal]:
    """Return all bad inputs."""
    found = []
    for inputs, lines in table(HERE / "refusals.txt").items():
        commands = dict(line.split(" = ", 1) for line in lines if line.startswith("@"))
        for line in lines:
            if not line.startswith("@"):
                name, recipe, command, expected = (part.strip() for part in line.split("|"))
                code, *names = expected.split(" ")
                command = commands.get(command, command)
                found.append(Refusal(inputs, name, steps(recipe), command, int(code), names))
    return found


def problem(one: Refusal, sound: Path, home: Path) -> str:
    """Spoil a copy of the sound inputs, run the command, and return what is not as expected."""
    shutil.copytree(sound, home, copy_function=shutil.copyfile)
    for step in one.recipe:
        spoil(home, step)
    code, printed = run(one.command, home)
    said = "".join(printed.split())
    missing = [name for name in one.names if name not in said]
    if code == one.code and not missing:
        return ""
    return f"{one.name}: exit {code}, not {one.code}; the message lacks {missing}:\n{printed}"
