"""Results of every track on the demo, and a command that reads them."""

from __future__ import annotations

from functools import cache

import pytest

from tests.cli.printed_results import (
    WIDE,
    Run,
    Said,
    says_not_a_number,
)
from tests.cli.results_of_all_tracks import (
    TRACKS,
    Scored,
    ScoresOf,
    score_methods,
)
from tests.support import run_main


@pytest.fixture(scope="session")
def scores_of(tmp_path_factory: pytest.TempPathFactory) -> ScoresOf:
    """Return a function that makes a track's results when they are first asked for."""

    @cache
    def scored(track: str) -> Scored:
        return score_methods(tmp_path_factory, track)

    return scored


@pytest.fixture(params=TRACKS)
def scored(request: pytest.FixtureRequest, scores_of: ScoresOf) -> Scored:
    return scores_of(request.param)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs a command, holds its exit code, and returns what it printed."""

    def call(*arguments: object, code: int = 0, width: int = WIDE) -> Said:
        monkeypatch.setenv("COLUMNS", str(width))
        capsys.readouterr()
        found = run_main(*arguments)
        said = Said(*capsys.readouterr())
        assert found == code, said.err
        assert not says_not_a_number(said.out), said.out
        return said

    return call
