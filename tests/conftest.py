"""Fixtures that most tests share."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings
from typer.testing import CliRunner, Result

from airzoo_bench.cli.main import app
from tests.support import BRIGHTON, MadeScene, made_protocol, write_benchmark

# Tests never assert times: a busy machine is no fault.
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")
# Under mutmut: the same cases for each mutant, and no search for the smallest that kills it.
settings.register_profile("mutants", derandomize=True, phases=(Phase.explicit, Phase.generate))

# What a shell starts in its background ignores Ctrl-C, and so would the processes that tests stop.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def brighton() -> Path:
    """Return the folder of the real scene, or skip where it is not there."""
    if not (BRIGHTON / "poses.json").is_file():
        pytest.skip("the real scene Brighton Beach is not beside the checkout")
    return BRIGHTON


@pytest.fixture
def scenes() -> list[MadeScene]:
    """Return two scenes: every query q has the tiles q and q + 1 as positives."""
    return [
        MadeScene("east", [[q, q + 1] for q in range(6)], 12),
        MadeScene("west", [[q, q + 1] for q in range(4)], 8),
    ]


@pytest.fixture
def data(tmp_path: Path, scenes: list[MadeScene], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a data root that holds the benchmark ``made``; it is the configured one."""
    root = tmp_path / "data"
    write_benchmark(root / "made", made_protocol(scenes), scenes)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(root))
    return root


@pytest.fixture
def perfect(scenes: list[MadeScene]) -> dict[str, list[object]]:
    """Return arrays of a perfect prediction: positives first, then the others."""
    ids, ranked = [], []
    for scene in scenes:
        for number, found in enumerate(scene.positives):
            rest = [t for t in range(scene.n_tiles) if t not in found]
            ids.append(scene.query(number))
            ranked.append([scene.tile(t) for t in [*found, *rest][:8]])
    return {"query_ids": ids, "ranked_ids": ranked}


@pytest.fixture
def command() -> Callable[..., Result]:
    """Return a function that runs the command line in this process."""
    runner = CliRunner()

    def run(*arguments: object) -> Result:
        return runner.invoke(app, [str(a) for a in arguments])

    return run
