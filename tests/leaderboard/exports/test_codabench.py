"""Bundles for Codabench: its unpacker's rules, and scoring on its folders by its command."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.leaderboard.exports.scoring import find_submitted
from airzoo_bench.leaderboard.exports.settings import WORST, finite, fitted
from airzoo_bench.leaderboard.sealed.scoring import told_of
from airzoo_bench.results.result import ScoreColumn
from tests.leaderboard.exports.platform import (
    IMAGE,
    Made,
    broken_predictions,
    check_competition,
    make,
    run_scoring,
    submitted_folder,
    unpacked,
)
from tests.support import run_main

TRACKS = ("retrieval", "matching", "reconstruction")


@pytest.fixture(scope="module", params=TRACKS)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make(request.param, tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def bundle(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    assert export(made, out) == 0
    return unpacked(out / "competition.zip", out / "unpacked")


@pytest.fixture(scope="module")
def retrieval(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make("retrieval", tmp_path_factory.mktemp("made"))


def export(made: Made, out: Path, *more: str) -> int:
    arguments = [*made.arguments, "--docker-image", IMAGE, "--out", str(out), *more]
    return run_main("export", "codabench", *arguments)


def scores_of(output: Path) -> dict[str, float]:
    # As the worker posts them: what requests refuses to send must not be there.
    scores = json.loads((output / "scores.json").read_text())
    json.dumps(scores, allow_nan=False)
    return dict(scores)


class TestOfEveryTrack:
    def test_follows_the_unpacker_s_rules(self, made: Made, bundle: Path) -> None:
        stated = check_competition(bundle)
        assert stated["docker_image"] == IMAGE
        assert stated["enable_detailed_results"] is True
        assert not [p for p in bundle.rglob("*") if p.suffix.lower() in (".jpg", ".jpeg")]

    def test_scores_as_eval_does(self, made: Made, bundle: Path, tmp_path: Path) -> None:
        submitted = submitted_folder(tmp_path / "res", made.predictions)
        run = run_scoring(bundle, submitted, tmp_path / "app", forked=True)
        assert run.exit_code == 0, run.stderr
        result = evaluate(made.predictions, data=made.data, protocol=made.protocol).result
        columns = check_competition(bundle)["leaderboards"][0]["columns"]
        scores = scores_of(run.output)
        assert set(scores) == {column["key"] for column in columns}
        headline = [column for column in result.columns if column.headline]
        for column, found in zip(headline, columns, strict=False):
            expected = result.overall[column.key]
            if math.isinf(expected):
                assert scores[found["key"]] == WORST
            else:
                percent = 100 if column.unit == "share" else 1
                assert scores[found["key"]] == pytest.approx(percent * expected, abs=1e-6)
            assert (found["sorting"] == "desc") == column.higher_is_better
        missing = {"retrieval": 1, "matching": 0, "reconstruction": 1}
        assert scores["failed"] == missing[made.track]
        assert "<table>" in (run.output / "detailed_results.html").read_text()

    def test_a_submission_at_fault_gets_a_message_and_no_scores(
        self, made: Made, bundle: Path, tmp_path: Path
    ) -> None:
        submitted = submitted_folder(tmp_path / "res", broken_predictions(tmp_path / "preds.npz"))
        run = run_scoring(bundle, submitted, tmp_path / "app")
        assert run.exit_code == 1
        assert "preds.npz" in run.stderr
        assert "Traceback" not in run.stderr
        assert str(tmp_path) not in run.stderr
        assert [p.name for p in run.output.iterdir()] == ["message.txt"]


class TestCode:
    def test_is_never_scored(self, tmp_path: Path) -> None:
        (tmp_path / "preds.npz").write_bytes(b"")
        (tmp_path / "metadata.yaml").write_text("command: python3 steal.py\n")
        with pytest.raises(SubmissionError, match="code was submitted"):
            find_submitted(tmp_path)

    @pytest.mark.parametrize("status", ["exitCode: 0\n", "elapsedTime: 1.5\nexitCode: 137\n"])
    def test_what_code_has_written_is_not_scored(self, status: str, tmp_path: Path) -> None:
        # The worker runs the command of a submission, and gives scoring what that has written.
        (tmp_path / "preds.npz").write_bytes(b"")
        (tmp_path / "metadata").write_text(status)
        with pytest.raises(SubmissionError, match="code was submitted"):
            find_submitted(tmp_path)

    def test_is_refused_by_the_command(self, retrieval: Made, tmp_path: Path) -> None:
        assert export(retrieval, tmp_path / "out") == 0
        bundle = unpacked(tmp_path / "out" / "competition.zip", tmp_path / "bundle")
        submitted = submitted_folder(tmp_path / "res", retrieval.predictions)
        run = run_scoring(bundle, submitted, tmp_path / "app", "exitCode: 0\n", forked=True)
        assert run.exit_code == 1
        assert "code was submitted" in run.stderr
        assert not (run.output / "scores.json").exists()

    @pytest.mark.parametrize("names", [(), ("a.npz", "b.npz")])
    def test_one_entry_is_expected(self, names: tuple[str, ...], tmp_path: Path) -> None:
        for name in names:
            (tmp_path / name).write_bytes(b"")
        with pytest.raises(SubmissionError, match="one file or one folder"):
            find_submitted(tmp_path)

    def test_links_are_not_followed(self, tmp_path: Path) -> None:
        (tmp_path / "preds.npz").symlink_to("/etc/passwd")
        with pytest.raises(SubmissionError, match="one file or one folder"):
            find_submitted(tmp_path)


class TestExport:
    def test_is_the_same_bytes_each_time(self, retrieval: Made, tmp_path: Path) -> None:
        for name in ("a", "b"):
            assert export(retrieval, tmp_path / name) == 0
        first, second = (sorted((tmp_path / name).iterdir()) for name in ("a", "b"))
        assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]

    def test_replaces_an_earlier_one_and_nothing_else(
        self, retrieval: Made, tmp_path: Path
    ) -> None:
        (tmp_path / "notes.txt").write_text("mine")
        (tmp_path / "competition.zip").write_text("old")
        assert export(retrieval, tmp_path) == 0
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {"notes.txt", "competition.zip", "Dockerfile"}
        assert (tmp_path / "competition.zip").read_bytes()[:2] == b"PK"

    def test_sealed_bundles_show_no_output(self, retrieval: Made, tmp_path: Path) -> None:
        assert export(retrieval, tmp_path, "--sealed") == 0
        bundle = unpacked(tmp_path / "competition.zip", tmp_path / "bundle")
        stated = check_competition(bundle)
        assert stated["enable_detailed_results"] is False
        assert stated["show_detailed_results_in_submission_panel"] is False
        assert stated["make_input_data_available"] is False
        [phase] = stated["phases"]
        assert all(phase[f"hide_{what}output"] for what in ("", "prediction_", "score_"))
        run = run_scoring(
            bundle, submitted_folder(tmp_path / "res", retrieval.predictions), tmp_path / "app"
        )
        assert run.exit_code == 0
        assert {p.name for p in run.output.iterdir()} == {"scores.json", "errors.json"}
        self.check_coarse(retrieval, scores_of(run.output), stated)

    def check_coarse(self, made: Made, scores: dict[str, float], stated: dict[str, Any]) -> None:
        """All but what was missing is told in the steps of `sealed`."""
        evaluation = evaluate(made.predictions, data=made.data, protocol=made.protocol)
        headline = tuple(column for column in evaluation.result.columns if column.headline)
        truth = evaluation.result.truth.fingerprint.encode()
        salt = hashlib.sha256(b"scores of an export\0" + truth).hexdigest()
        _, told = told_of(evaluation, headline, salt)
        assert scores["failed"] == 1
        for column, found in zip(headline, stated["leaderboards"][0]["columns"], strict=False):
            one = told[column.key]
            assert one.value is not None
            percent = 100 if column.unit == "share" else 1
            assert scores[found["key"]] == pytest.approx(percent * one.value)
            assert one.value != evaluation.result.overall[column.key]

    def test_sealed_bundles_do_not_say_what_is_wrong(self, retrieval: Made, tmp_path: Path) -> None:
        assert export(retrieval, tmp_path, "--sealed") == 0
        bundle = unpacked(tmp_path / "competition.zip", tmp_path / "bundle")
        submitted = submitted_folder(tmp_path / "res", broken_predictions(tmp_path / "preds.npz"))
        run = run_scoring(bundle, submitted, tmp_path / "app")
        assert run.exit_code == 1
        assert "airzoo-bench check" in run.stderr
        assert "preds.npz" not in run.stderr

    def test_image_is_required(
        self, retrieval: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run_main("export", "codabench", *retrieval.arguments, "--out", tmp_path) == 2
        assert "--docker-image" in capsys.readouterr().err

    def test_image_is_a_name(
        self, retrieval: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        arguments = [*retrieval.arguments, "--docker-image", "a b\nc", "--out", tmp_path / "x"]
        assert run_main("export", "codabench", *arguments) == 2
        assert "is no name of an image" in capsys.readouterr().err
        assert not (tmp_path / "x").exists()

    def test_dockerfile_has_this_version(self, retrieval: Made, tmp_path: Path) -> None:
        from airzoo_bench import __version__

        assert export(retrieval, tmp_path) == 0
        assert f"airzoo-bench=={__version__}\n" in (tmp_path / "Dockerfile").read_text()

    @pytest.mark.parametrize(
        ("phases", "fault"),
        [
            (["Dev,2027-01-01,2027-02-01", "Test,2027-02-01"], "before Dev has ended"),
            (["Dev,2027-01-01", "Test,2027-02-01"], "has no end"),
            (["Dev,2027-01-01,2027-01-02", "dev,2027-02-01"], "same name"),
            (["Dev,2027-02-01,2027-01-01"], "ends before it begins"),
            (["Dev,tomorrow"], "cannot be read"),
            (["2027-01-01"], "1 parts, not two or three"),
            (["a,2027-01-01,2027-01-02,2027-01-03"], "cannot be read"),
        ],
    )
    def test_phases_that_the_platform_refuses(
        self,
        phases: list[str],
        fault: str,
        retrieval: Made,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        options = [text for phase in phases for text in ("--phase", phase)]
        base = [retrieval.protocol, "--data", retrieval.data, "--docker-image", IMAGE]
        assert run_main("export", "codabench", *base, *options, "--out", tmp_path / "x") == 2
        assert fault in capsys.readouterr().err

    def test_phases_that_follow_each_other(self, retrieval: Made, tmp_path: Path) -> None:
        more = ["--phase", "Later,2027-03-02"]
        assert export(retrieval, tmp_path, *more) == 0
        stated = check_competition(unpacked(tmp_path / "competition.zip", tmp_path / "bundle"))
        assert [phase["name"] for phase in stated["phases"]] == ["Test", "Later"]


def column(unit: str, title: str = "E", key: str = "e") -> ScoreColumn:
    return ScoreColumn.model_validate(
        {
            "key": key,
            "title": title,
            "unit": unit,
            "higher_is_better": unit == "share",
            "average": "mean",
            "headline": True,
        }
    )


def test_numbers_are_finite_and_fit_the_platform() -> None:
    assert finite(column("m"), math.inf) == WORST
    assert finite(column("m"), 1e300) == WORST
    assert finite(column("deg"), 1 / 3) == 0.333333
    assert finite(column("share"), 1 / 3) == 33.333333


def test_long_names_stay_different() -> None:
    names = {fitted(f"{'a' * 60}{number}", 36) for number in range(20)}
    assert len(names) == 20
    assert {len(name) for name in names} == {36}
    assert fitted("short", 36) == "short"


def test_text_of_a_protocol_stays_text(retrieval: Made, tmp_path: Path) -> None:
    """YAML of a title with quotes, colons, markup and letters beyond the basic plane."""
    from airzoo_bench.leaderboard.exports.templates import rendered, yaml_text

    hostile = "a: \"b\" 'c' #d {{e}} <script>\N{GRINNING FACE}\x7f\x1b"
    assert yaml.safe_load(yaml_text(hostile)) == hostile.replace("\x7f", "�").replace("\x1b", "�")
    text = rendered("terms.md")
    assert text.startswith("# Terms")
