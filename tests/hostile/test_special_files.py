"""Pipes, devices and sockets where files should be: refused, never opened, never passed over."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from tests.support import run_main


def special(kind: str, path: Path) -> None:
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "socket":
            with socket.socket(socket.AF_UNIX) as one:
                one.bind(str(path))
        case "device":
            path.symlink_to("/dev/zero")
        case _:
            path.symlink_to(path.parent / "absent")


KINDS = ["pipe", "socket", "device", "link to nothing"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", ["eval retrieval", "eval matching", "eval reconstruction"])
def test_given_to_a_command(
    kind: str,
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    special(kind, Path("one.npz"))
    for words in (command, "check"):
        assert run_main(*words.split(), "one.npz") == 2
        assert capsys.readouterr().err.startswith("airzoo-bench: one.npz: ")
