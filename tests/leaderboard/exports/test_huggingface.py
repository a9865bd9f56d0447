"""The dataset repository, read back by huggingface_hub's own parsers."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
import pytest
import yaml

from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.results.result import read_result
from tests.leaderboard.exports.platform import Made, make
from tests.support import run_main

hub = pytest.importorskip("huggingface_hub", reason="the extra download is not installed")

HOSTILE = '---\nlicense: mit | <script>alert(1)</script> ![x](https://evil.example/x) "=1+1'
DATASET = "airzoo/leaderboard"
OPTIONS = ["--dataset", DATASET, "--licence", "cc-by-4.0"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Made]:
    tracks = ("retrieval", "reconstruction")
    return {track: make(track, tmp_path_factory.mktemp(track)) for track in tracks}


@pytest.fixture(scope="module")
def runs(made: dict[str, Made], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    home = tmp_path_factory.mktemp("runs")
    found = []
    for number, (track, method) in enumerate(
        [("retrieval", "plain"), ("retrieval", HOSTILE), ("reconstruction", "plain")]
    ):
        one = made[track]
        evaluation = evaluate(
            one.predictions, data=one.data, protocol=one.protocol, track=track, method=method
        )
        save(evaluation, home / str(number))
        found.append(home / str(number))
    return found


@pytest.fixture(scope="module")
def out(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    assert run_main("export", "huggingface", *runs, *OPTIONS, "--out", folder) == 0
    return folder


class TestCard:
    def test_is_read_by_the_hub_s_client(self, out: Path) -> None:
        card = hub.DatasetCard.load(out / "dataset" / "README.md")
        assert card.data.license == "cc-by-4.0"
        assert card.data.pretty_name == "AirZoo leaderboard"
        [config] = card.data.to_dict()["configs"]
        [files] = config["data_files"]
        assert (out / "dataset" / files["path"]).is_file()

    def test_names_stay_names(self, out: Path) -> None:
        card = hub.DatasetCard.load(out / "dataset" / "README.md")
        assert "<script" not in card.text
        assert "![x](" not in card.text
        assert "mit" not in str(card.data.license)

    def test_titles_stay_titles(self, runs: list[Path], tmp_path: Path) -> None:
        arguments = [*runs, *OPTIONS, "--title", HOSTILE, "--out", tmp_path]
        assert run_main("export", "huggingface", *arguments) == 0
        card = hub.DatasetCard.load(tmp_path / "dataset" / "README.md")
        assert card.data.pretty_name == HOSTILE
        assert card.data.license == "cc-by-4.0"
        assert "<script" not in card.text


class TestData:
    def test_every_score_of_every_scene_is_a_row(self, out: Path, runs: list[Path]) -> None:
        rows = pd.read_parquet(out / "dataset" / "data" / "results.parquet")
        results = [read_result(run / "result.json") for run in runs]
        expected = sum(len(r.columns) * (len(r.scenes) + 1) for r in results)
        assert len(rows) == expected
        assert not rows["value"].isna().any()
        for result in results:
            own = rows[
                (rows["method"] == result.predictions.method)
                & (rows["protocol"] == result.protocol.name)
                & (rows["scene"] == "overall")
            ]
            found = dict(zip(own["score"], own["value"], strict=True))
            assert found == result.overall

    def test_failures_are_infinite_not_missing(self, out: Path) -> None:
        rows = pd.read_parquet(out / "dataset" / "data" / "results.parquet")
        chamfer = rows[(rows["score"] == "chamfer_m") & (rows["scene"] == "overall")]
        assert [math.isinf(value) for value in chamfer["value"]] == [True]

    def test_intervals_hold_their_values(self, out: Path) -> None:
        rows = pd.read_parquet(out / "dataset" / "data" / "results.parquet").dropna(subset=["low"])
        assert len(rows)
        assert (rows["low"] <= rows["value"]).all()
        assert (rows["value"] <= rows["high"]).all()

    def test_results_are_there_as_they_were_scored(self, out: Path, runs: list[Path]) -> None:
        written = sorted((out / "dataset" / "results").glob("*/*.json"))
        assert {p.read_bytes() for p in written} == {(r / "result.json").read_bytes() for r in runs}

    def test_is_the_same_bytes_each_time(self, out: Path, runs: list[Path], tmp_path: Path) -> None:
        assert run_main("export", "huggingface", *runs, *OPTIONS, "--out", tmp_path) == 0
        first, second = (
            {p.relative_to(home): p.read_bytes() for p in home.rglob("*") if p.is_file()}
            for home in (out, tmp_path)
        )
        assert first == second


class TestCommunityEvaluations:
    def test_benchmark_states_its_tasks(self, out: Path, made: dict[str, Made]) -> None:
        stated = yaml.safe_load((out / "dataset" / "eval.yaml").read_text(encoding="utf-8"))
        assert set(stated) == {"name", "description", "evaluation_framework", "tasks"}
        assert {task["id"] for task in stated["tasks"]} == {one.protocol for one in made.values()}

    def test_entries_are_read_by_the_hub_s_client(self, out: Path, runs: list[Path]) -> None:
        files = sorted((out / "models").glob("*/.eval_results/leaderboard.yaml"))
        names = {read_result(run / "result.json").predictions.method for run in runs}
        assert len(files) == len(names) == 2
        tasks = yaml.safe_load((out / "dataset" / "eval.yaml").read_text(encoding="utf-8"))
        known = {task["id"] for task in tasks["tasks"]}
        for file in files:
            entries = hub.parse_eval_result_entries(
                yaml.safe_load(file.read_text(encoding="utf-8"))
            )
            assert entries
            for entry in entries:
                assert entry.dataset_id == DATASET
                assert entry.task_id in known
                assert 0 <= entry.value <= 100
                assert entry.notes is not None
                assert "airzoo-bench" in entry.notes

    def test_sources_are_linked(self, runs: list[Path], tmp_path: Path) -> None:
        more = ["--source", "https://board.example.org", "--out", tmp_path]
        assert run_main("export", "huggingface", *runs, *OPTIONS, *more) == 0
        for file in (tmp_path / "models").glob("*/.eval_results/*.yaml"):
            for entry in hub.parse_eval_result_entries(yaml.safe_load(file.read_text())):
                assert entry.source_url == "https://board.example.org"

    def test_folders_have_plain_names(self, out: Path) -> None:
        names = sorted(path.name for path in (out / "models").iterdir())
        assert names[0] == "001-plain"
        assert all(name.replace("-", "").isalnum() for name in names)


@pytest.mark.parametrize(
    ("licence", "written"), [("CC-BY-4.0", "cc-by-4.0"), ("odbl", "odbl"), ("Other", "other")]
)
def test_licences_are_written_as_the_hub_does(
    licence: str, written: str, runs: list[Path], tmp_path: Path
) -> None:
    options = ["--dataset", DATASET, "--licence", licence, "--out", tmp_path]
    assert run_main("export", "huggingface", *runs, *options) == 0
    assert f'license: "{written}"\n' in (tmp_path / "dataset/README.md").read_text()


@pytest.mark.parametrize("licence", ["mine", "MIT OR Apache-2.0", "LicenseRef-x", "a\nb: c", ""])
def test_licences_that_the_hub_does_not_know(
    licence: str, runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--dataset", DATASET, "--licence", licence, "--out", tmp_path / "x"]
    assert run_main("export", "huggingface", *runs, *options) == 2
    assert "the hub knows no licence" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("dataset", ["nowhere", "../x/y", "a/b/c", "a b/c", "-a/b", ""])
def test_datasets_that_are_none(
    dataset: str, runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [f"--dataset={dataset}", "--licence", "mit", "--out", tmp_path / "x"]
    assert run_main("export", "huggingface", *runs, *options) == 2
    assert "is no dataset" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
