"""Web servers that refuse, break off, or answer what is no answer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from airzoo_bench.storage.mirror import here
from tests.storage.faults import CONTENT, always
from tests.storage.servers import Answer, Asked, Front
from tests.support import run_main


def test_a_web_download_that_breaks_off_is_tried_again(
    web: tuple[Path, Front], mirrors: Path
) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(CONTENT)
    front.change = once(lambda real: Answer(200, real.headers, real.body[:6000], len(CONTENT)))
    assert here(f"{front.address}/p.npz").read_bytes() == CONTENT


def once(change: Callable[[Answer], Answer]) -> Callable[[Asked, Answer], Answer]:
    """Change the first answer with a body."""
    left = [change]
    return lambda asked, real: left.pop()(real) if left and asked.method == "GET" else real


@pytest.mark.parametrize(("status", "said"), [(404, "no such"), (403, "denied"), (503, "503")])
def test_what_a_web_server_refuses(
    web: tuple[Path, Front], status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _, front = web
    front.change = always(Answer(status, {}))
    assert run_main("check", f"{front.address}/p.npz?signature=secret") == 2
    message = capsys.readouterr().err
    assert said in message
    assert "/p.npz?…" in message
    assert "secret" not in message
