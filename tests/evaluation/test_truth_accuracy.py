"""A stated accuracy of the truth: kept in the folder, and said where thresholds are finer."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from airzoo_bench.evaluation.evaluate import accuracy_notes
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import Protocol
from tests.support import make_place, run_main


def protocol(track: str) -> Protocol:
    shipped = load_protocol(shipped_protocols()[f"photos-{track}"])
    return shipped.model_copy(update={"scenes": (shipped.scenes[0],)})


@pytest.mark.parametrize(
    ("track", "accuracy_m", "fine"),
    [
        ("matching", 0.33, None),
        ("matching", 0.34, "the threshold 1 m of photos-matching measures"),
        ("matching", 4.0, "the thresholds 1, 5, 10 m of photos-matching measure"),
        ("retrieval", 8.3, None),
        ("retrieval", 8.4, "the threshold 25 m of photos-retrieval measures"),
        ("reconstruction", 0.7, "the thresholds 1, 2 m of photos-reconstruction measure"),
        ("matching", None, None),
    ],
)
def test_thresholds_below_three_times_the_accuracy_are_named(
    track: str, accuracy_m: float | None, fine: str | None
) -> None:
    used = protocol(track)
    notes = accuracy_notes(used, {used.scenes[0].id: accuracy_m, "elsewhere": 1e9})
    assert len(notes) == (fine is not None)
    if fine is not None:
        assert fine in notes[0]
        assert f"good to {accuracy_m:g} m" in notes[0]


def test_it_is_said_by_prepare_and_by_eval(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    place = make_place(tmp_path / "sources")
    assert run_main(*place.arguments(**{"truth-accuracy": 10.0})) == 0
    expected = "of park-retrieval measures errors of the truth too"
    said = capsys.readouterr().err
    assert "warning: the truth of 1 scene (park) is stated to be good to 10 m: " in said
    assert f"the threshold 25 m {expected}" in said
    folder = tmp_path / "data" / "park"
    file = tomllib.loads((folder / "benchmark.toml").read_text())
    assert file["scenes"][0]["truth_accuracy_m"] == 10.0
    predictions = tmp_path / "p.npz"
    assert run_main("template", "park-retrieval", "--out", predictions) == 0
    capsys.readouterr()
    assert run_main("eval", "retrieval", predictions) == 0
    said = capsys.readouterr()
    assert expected in " ".join((said.out + said.err).split())


@pytest.mark.parametrize("value", ["0", "-1", "inf"])
def test_what_is_no_accuracy_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    value: str,
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    place = make_place(tmp_path / "sources")
    assert run_main(*place.arguments(**{"truth-accuracy": value})) == 2
    assert "--truth-accuracy" in capsys.readouterr().err
