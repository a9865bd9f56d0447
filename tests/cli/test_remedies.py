"""Ways to mend a fault: no message names an option that the command at hand does not have."""

from __future__ import annotations

import pytest
import typer

from airzoo_bench.cli.main import app, options_of, own_ways
from airzoo_bench.core.errors import PredictionError
from tests.support import run_main

WHOLE = (
    "start it again; `eval` with --resume goes on",
    "run the method again with --save_descriptors",
    "prepare with --copy",
)
MESH = "raise --max-memory, or sample the mesh and give the points"


@pytest.mark.parametrize(
    ("command", "fix"),
    [
        ("eval reconstruction", MESH),
        ("check", MESH),
        ("seal-score", "sample the mesh and give the points"),
        ("prepare photos", "sample the mesh and give the points"),
        ("table", "sample the mesh and give the points"),
    ],
)
def test_only_ways_that_the_command_has_are_said(
    command: str, fix: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise PredictionError("too large", where="x.obj", fix=MESH)

    monkeypatch.setattr(typer.Typer, "__call__", refuse)
    assert run_main(*command.split(), "preds.npz") == 2
    said = capsys.readouterr().err
    assert said == f"airzoo-bench: x.obj: too large\n  fix:      {fix}\n"


def tree() -> object:
    return typer.main.get_command(app)


@pytest.mark.parametrize(
    ("fix", "left"),
    [
        (None, None),
        ("raise --max-memory", None),
        ("name it with --data, or set X", "set X"),
        *((whole, whole) for whole in WHOLE),
        ("add --engine dask, or lower --jobs", "lower --jobs"),
    ],
)
def test_what_is_left_of_a_fix(fix: str | None, left: str | None) -> None:
    assert own_ways(fix, {"--jobs"}) == left


def test_options_of_a_command() -> None:
    root = tree()
    assert "--resume" in options_of(root, ["eval", "retrieval", "--out", "x"])
    assert "--resume" not in options_of(root, ["prepare", "airzoo-mini"])
    assert options_of(root, []) >= {"--version"}
    assert options_of(root, ["no-such-command"]) == options_of(root, [])
