"""`airzoo-bench plot`: kinds, options, sizes, and what cannot be drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.report.figures import parse_length
from tests.report.made import reconstruction_method, retrieval_method, run, write_methods


@pytest.mark.parametrize(
    ("text", "inches"), [("3.3in", 3.3), ("8.4 cm", 8.4 / 2.54), (".5E", None)]
)
def test_a_width_is_in_inches_or_centimetres(text: str, inches: float | None) -> None:
    if inches is not None:
        assert parse_length(text) == pytest.approx(inches)
        return
    with pytest.raises(UsageError, match="no width"):
        parse_length(text)


@pytest.mark.parametrize(
    "ask",
    [
        ("recall",),
        ("recall", "--up-to", 3),
        ("errors",),
        ("intervals", "--score", "R@1"),
        ("scenes",),
        ("condition", "--by", "weather"),
        ("condition", "--by", "altitude_m", "--bins", "50,100"),
        ("condition", "--by", "scene", "--score", "error_m", "--width", "8.4cm"),
    ],
)
def test_every_kind_is_drawn(tmp_path: Path, ask: tuple[object, ...]) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), retrieval_method("b", 1)])
    done = run("plot", ask[0], *paths, *ask[1:], "-o", tmp_path / "x.svg")
    assert done.exit_code == 0, done.output
    assert "<svg" in (tmp_path / "x.svg").read_text()


def test_thresholds_are_of_reconstruction(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [reconstruction_method("a", 0), reconstruction_method("b", 1)])
    done = run("plot", "thresholds", *paths, "-o", tmp_path / "x.png")
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (("thresholds", "-o", "x.png"), "no precision over distance"),
        (("recall", "-o", "x.gif"), "cannot be written as .gif"),
        (("recall", "-o", "x."), "without an ending"),
        (("recall", "--up-to", 9, "-o", "x.png"), "keeps 5 ranks"),
        (("condition", "--by", "wether", "-o", "x.png"), "'weather'"),
        (("errors", "--score", "R@1", "-o", "x.png"), "no error"),
        (("scenes", "--score", "recall@", "-o", "x.png"), "'recall@1'"),
        (("recal", "-o", "x.png"), "did you mean 'recall'"),
        (("recall", "--width", "wide", "-o", "x.png"), "no width"),
        (("recall", "--scene", "eats", "-o", "x.png"), "no scene 'eats'"),
    ],
)
def test_what_cannot_be_drawn(tmp_path: Path, ask: tuple[object, ...], said: str) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    where = [tmp_path / a if str(a).startswith("x.") else a for a in ask]
    done = run("plot", where[0], path, *where[1:])
    assert isinstance(done.exception, UserError)
    assert said in str(done.exception)
    assert not list(tmp_path.glob("x.*"))
