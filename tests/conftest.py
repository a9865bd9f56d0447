"""Fixtures that most tests share."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import jinja2
import pytest
import typer
from hypothesis import HealthCheck, Phase, settings
from typer.testing import CliRunner, Result

from airzoo_bench.cli.main import app
from airzoo_bench.cli.progress import report_progress
from tests.support import BRIGHTON, MadeScene, made_protocol, write_benchmark

# Tests never assert times: a busy machine is no fault.
settings.register_profile(
    "any machine", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")
settings.register_profile("nightly", settings.get_profile("any machine"), max_examples=500)
# Under mutmut: the same cases for each mutant, and no search for the smallest that kills it.
settings.register_profile(
    "mutants", derandomize=True, max_examples=100, phases=(Phase.explicit, Phase.generate)
)

# Files that take longest, begun first: one that began last would keep a single worker busy.
LONGEST = """goldens/test_goldens leaderboard/test_walk_through leaderboard/test_site
 report/test_pictures readers/test_contract storage/test_urls leaderboard/test_sealed
 reconstruction/test_track evaluation/test_runs report/test_report engines/test_tracks
 engines/test_engines leaderboard/test_hostile datasets/mini/test_frames datasets/test_contract
 datasets/mini/test_prepare oracles/test_paper_tables report/test_browser
 audit/test_honest_tables"""
PLACES = {Path(__file__).parent / f"{name}.py": place for place, name in enumerate(LONGEST.split())}

# What a shell starts in its background ignores Ctrl-C, and so would the processes that tests stop.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist keep the order of the files; by itself it begins with many short tests."""
    if missing := [str(path) for path in PLACES if not path.is_file()]:
        raise pytest.UsageError(f"tests/conftest.py: LONGEST: no such file: {', '.join(missing)}")
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Give all tests that lack the same thing one place, and so one line of the summary."""
    report = yield
    if report.skipped and isinstance(report.longrepr, tuple):
        report.longrepr = (str(Path(__file__).parent), None, report.longrepr[2])
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: PLACES.get(item.path, len(PLACES)))


@pytest.fixture(scope="session", autouse=True)
def _nothing_takes_long() -> Iterator[None]:
    """Leave out lines that name what takes over two seconds: that depends on the machine."""
    with mock.patch.dict(report_progress.__kwdefaults__, first_s=1e6):
        yield


@pytest.fixture(scope="session", autouse=True)
def _commands_and_templates_built_once() -> Iterator[None]:
    """Build the tree of commands once, 50 ms, and compile each template once, half a second."""
    build, translate = typer.main.get_command, jinja2.Environment.compile
    tree, translated = build(app), {}

    def built(one: typer.Typer) -> Any:
        return tree if one is app else build(one)

    def compiled(env: jinja2.Environment, source: str, *place: Any, **options: Any) -> Any:
        key = source, place, env.autoescape, env.trim_blocks, env.lstrip_blocks, env.finalize
        if options:
            return translate(env, source, *place, **options)
        if key not in translated:
            translated[key] = translate(env, source, *place)
        return translated[key]

    with (
        mock.patch("typer.main.get_command", built),
        mock.patch("typer.testing._get_command", built),
        mock.patch.object(jinja2.Environment, "compile", compiled),
    ):
        yield


@pytest.fixture(scope="session")
def brighton() -> Path:
    """Return the folder of the real scene, or skip where it is not there."""
    if not (BRIGHTON / "poses.json").is_file():
        pytest.skip("no real scene in ../shared/real/brighton: docs/brighton.md says what it is")
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
