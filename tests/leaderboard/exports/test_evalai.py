"""Challenges for EvalAI: its config's rules, and the worker against a server that answers as it."""

from __future__ import annotations

import datetime
import importlib.util
import json
import math
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import yaml

from airzoo_bench.core.errors import UsageError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.leaderboard.exports import evalai_worker
from airzoo_bench.leaderboard.exports.evalai_api import Api
from tests.leaderboard.exports.evalai_server import (
    CHALLENGE,
    QUEUE,
    TOKEN,
    EvalAI,
    running_evalai,
)
from tests.leaderboard.exports.platform import Made, broken_predictions, make, unpacked
from tests.support import run_main


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make("retrieval", tmp_path_factory.mktemp("made"))


@pytest.fixture(scope="module")
def exported(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    assert run_main("export", "evalai", *made.arguments, "--out", out) == 0
    return out


@pytest.fixture(scope="module")
def config(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = unpacked(exported / "challenge.zip", tmp_path_factory.mktemp("challenge"))
    return check_challenge(folder)


def check_challenge(folder: Path) -> dict[str, Any]:
    """Hold a challenge to what EvalAI's `challenge_config_utils` refuses."""
    stated = yaml.safe_load((folder / "challenge_config.yaml").read_text(encoding="utf-8"))
    named = [stated["title"], *(one["name"] for one in stated["dataset_splits"])]
    named += [phase[key] for phase in stated["challenge_phases"] for key in ("name", "codename")]
    assert all(0 < len(name) <= 100 for name in named)
    pages = ("description", "evaluation_details", "terms_and_conditions", "submission_guidelines")
    phases = stated["challenge_phases"]
    for page in [*(stated[name] for name in pages), *(phase["description"] for phase in phases)]:
        assert page.endswith(".html")
        assert (folder / page).read_text(encoding="utf-8")
    assert (folder / stated["image"]).is_file()
    assert stated["evaluation_script"].endswith(".zip")
    assert zipfile.is_zipfile(folder / stated["evaluation_script"])
    for one in [stated, *phases]:
        assert isinstance(one["start_date"], datetime.datetime)
        assert one["start_date"] < one["end_date"]
    codenames = [phase["codename"] for phase in phases]
    assert len(codenames) == len(set(codenames))
    [board] = stated["leaderboard"]
    assert board["schema"]["default_order_by"] in board["schema"]["labels"]
    keys = {"leaderboard_id", "challenge_phase_id", "dataset_split_id", "visibility"}
    keys |= {"leaderboard_decimal_precision", "is_leaderboard_order_descending"}
    for split in stated["challenge_phase_splits"]:
        assert keys <= set(split)
        assert split["challenge_phase_id"] in [phase["id"] for phase in phases]
    assert [split["id"] for split in stated["dataset_splits"]] == [1]
    return dict(stated)


@pytest.fixture
def server(made: Made, config: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Iterator[EvalAI]:
    labels = config["leaderboard"][0]["schema"]["labels"]
    with running_evalai(made.protocol, labels) as found:
        monkeypatch.setenv("AUTH_TOKEN", TOKEN)
        monkeypatch.setenv("API_SERVER", found.url)
        monkeypatch.setenv("QUEUE_NAME", QUEUE)
        monkeypatch.setenv("CHALLENGE_PK", str(CHALLENGE))
        yield found


def work(exported: Path) -> None:
    assert evalai_worker.main([str(exported / "worker")], endless=False, pause=0) == 0


class TestChallenge:
    def test_is_scored_by_its_host(self, config: dict[str, Any]) -> None:
        assert config["remote_evaluation"] is True

    def test_sorts_each_score_its_way(self, made: Made, config: dict[str, Any]) -> None:
        schema = config["leaderboard"][0]["schema"]
        result = evaluate(made.predictions, data=made.data, protocol=made.protocol).result
        headline = [column for column in result.columns if column.headline]
        ways = [entry["sort_ascending"] for entry in schema["metadata"].values()]
        assert ways[: len(headline)] == [not column.higher_is_better for column in headline]
        assert set(schema["metadata"]) == set(schema["labels"])
        assert schema["metadata"]["Failed"]["sort_ascending"] is True
        [split] = config["challenge_phase_splits"]
        assert split["is_leaderboard_order_descending"] == headline[0].higher_is_better

    def test_has_no_truth_in_what_is_uploaded(self, exported: Path) -> None:
        with zipfile.ZipFile(exported / "challenge.zip") as archive:
            assert not [n for n in archive.namelist() if n.endswith((".npz", ".csv", ".parquet"))]

    def test_long_titles_are_cut(self, made: Made, tmp_path: Path) -> None:
        folder = Path(shutil.copytree(made.data, tmp_path / "data"))
        file = folder / "made" / "protocols" / f"{made.protocol}.toml"
        values = tomllib.loads(file.read_text()) | {"title": "t" * 120}
        file.write_text(tomli_w.dumps(values))
        arguments = [made.protocol, "--data", folder, "--phase", "Test,2027-01-01,2027-02-01"]
        assert run_main("export", "evalai", *arguments, "--out", tmp_path / "out") == 0
        check_challenge(unpacked(tmp_path / "out" / "challenge.zip", tmp_path / "challenge"))

    def test_phases_must_end(
        self, made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        arguments = [made.protocol, "--data", made.data, "--phase", "Test,2027-01-01"]
        assert run_main("export", "evalai", *arguments, "--out", tmp_path / "x") == 2
        assert "has no end" in capsys.readouterr().err

    def test_evaluation_script_answers_with_error_bars(self, made: Made, exported: Path) -> None:
        folder = exported / "worker"
        spec = importlib.util.spec_from_file_location(
            "evaluation_script",
            folder / "evaluation_script" / "__init__.py",
            submodule_search_locations=[str(folder / "evaluation_script")],
        )
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(__import__("sys").modules, "evaluation_script", module)
            spec.loader.exec_module(module)
            output = module.evaluate(str(made.predictions), "test", str(folder))
        [result], [error] = output["result"], output["error"]
        assert list(result) == list(error) == [made.protocol]
        for title, half_width in error[made.protocol].items():
            assert result[made.protocol][f"± {title}"] == half_width
            assert math.isfinite(half_width)
            assert half_width > 0
        assert made.predictions.is_file()


class TestWorker:
    def test_scores_as_eval_does(self, made: Made, exported: Path, server: EvalAI) -> None:
        number = server.submit("preds.npz", made.predictions.read_bytes())
        work(exported)
        assert server.refused == []
        assert server.submissions[number]["status"] == "finished"
        assert server.statuses == [(number, "running")]
        assert server.queue == []
        result = evaluate(made.predictions, data=made.data, protocol=made.protocol).result
        scores = server.leaderboard[number]
        for column in result.columns:
            if column.headline and column.unit == "share":
                expected = 100 * result.overall[column.key]
                assert scores[f"{column.title} [%]"] == pytest.approx(expected, abs=1e-6)
        assert scores["Failed"] == 1
        [entry] = json.loads(server.told[number]["result"])
        assert set(entry["error"]) == {t for t in scores if f"± {t}" in scores}

    def test_a_bad_submission_fails_with_its_message(
        self, made: Made, exported: Path, server: EvalAI, tmp_path: Path
    ) -> None:
        bad = server.submit("bad.npz", broken_predictions(tmp_path / "bad.npz").read_bytes())
        good = server.submit("preds.npz", made.predictions.read_bytes())
        work(exported)
        assert server.submissions[bad]["status"] == "failed"
        assert "bad.npz" in server.told[bad]["stderr"]
        assert "Traceback" not in server.told[bad]["stderr"]
        assert bad not in server.leaderboard
        assert server.submissions[good]["status"] == "finished"
        assert server.queue == []

    def test_a_fault_of_the_host_is_not_called_the_submission_s(
        self, made: Made, exported: Path, server: EvalAI, tmp_path: Path
    ) -> None:
        copy = Path(shutil.copytree(exported / "worker", tmp_path / "worker"))
        (copy / "reference" / "benchmark.toml").write_text("broken")
        number = server.submit("preds.npz", made.predictions.read_bytes())
        assert evalai_worker.main([str(copy)], endless=False, pause=0) == 0
        assert server.submissions[number]["status"] == "failed"
        assert "no fault of the submission" in server.told[number]["stderr"]
        assert "benchmark.toml" not in server.told[number]["stderr"]

    def test_the_token_goes_to_the_api_alone(
        self, made: Made, exported: Path, server: EvalAI
    ) -> None:
        server.submit("preds.npz", made.predictions.read_bytes())
        work(exported)
        for _, path, token in server.seen:
            assert (token is None) == path.startswith("/media/")

    def test_scoring_processes_do_not_have_the_token(
        self, exported: Path, server: EvalAI, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        seen = {}

        def run(call: list[str], **given: Any) -> Any:
            seen.update(given["env"])
            raise RuntimeError("not run")

        monkeypatch.setattr(evalai_worker.subprocess, "run", run)
        server.submit("preds.npz", b"")
        work(exported)
        assert "PATH" in seen
        assert TOKEN not in seen.values()

    def test_done_and_strange_messages_leave_the_queue_unscored(
        self, exported: Path, server: EvalAI
    ) -> None:
        done = server.submit("preds.npz", b"")
        server.submissions[done]["status"] = "cancelled"
        server.submit("preds.npz", b"", challenge=99)
        work(exported)
        assert server.queue == []
        assert server.told == {}

    def test_what_was_running_when_the_worker_stopped_is_scored_again(
        self, made: Made, exported: Path, server: EvalAI
    ) -> None:
        number = server.submit("preds.npz", made.predictions.read_bytes())
        server.submissions[number]["status"] = "running"
        work(exported)
        assert server.submissions[number]["status"] == "finished"

    def test_an_answer_that_is_none_keeps_the_message(
        self, exported: Path, server: EvalAI, capsys: pytest.CaptureFixture[str]
    ) -> None:
        server.submit("preds.npz", b"")
        server.broken = 1
        work(exported)
        assert len(server.queue) == 1
        assert "502" in capsys.readouterr().err

    @pytest.mark.parametrize("name", ["AUTH_TOKEN", "API_SERVER", "QUEUE_NAME", "CHALLENGE_PK"])
    def test_variables_are_required(
        self, name: str, exported: Path, server: EvalAI, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.delenv(name)
        with pytest.raises(UsageError, match=f"{name} not set"):
            work(exported)

    def test_a_mistake_is_one_message(self, exported: Path) -> None:
        module = "airzoo_bench.leaderboard.exports.evalai_worker"
        for arguments, said in (([], "no folder is named"), ([exported], "no worker's folder")):
            call = [sys.executable, "-m", module, *map(str, arguments)]
            done = subprocess.run(call, capture_output=True, text=True, check=False)
            assert (done.returncode, done.stderr.count("\n")) == (2, 2)
            assert said in done.stderr

    @pytest.mark.parametrize("address", ["http://eval.ai", "ftp://localhost", "eval.ai"])
    def test_the_token_is_never_sent_in_the_clear(self, address: str) -> None:
        with pytest.raises(UsageError, match="without encryption"):
            Api(address, TOKEN)

    def test_the_token_follows_no_redirect(self, server: EvalAI) -> None:
        with pytest.raises(OSError, match="302"):
            Api(server.url, TOKEN).call("GET", "/moved")
        assert [path for _, path, _ in server.seen] == ["/moved"]

    def test_files_of_the_machine_are_not_submissions(self, tmp_path: Path) -> None:
        with pytest.raises(ValueError, match="no web address"):
            Api("https://eval.ai", TOKEN).download("file:///etc/passwd", tmp_path)
