"""A web server for tests of what is fetched."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.leaderboard.web_server import WebServer, running_server


@pytest.fixture(scope="module")
def _running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebServer]:
    with running_server(tmp_path_factory.mktemp("authority")) as found:
        yield found


@pytest.fixture
def web(_running: WebServer) -> WebServer:
    """Return a server that has answered nothing yet."""
    for seen in (_running.answers, _running.requests):
        seen.clear()
    return _running
