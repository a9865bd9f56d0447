"""What a run would replace is never what it is made from."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.run_files import check_run_folder, save
from tests.support import files_below, run_main, write_predictions


@pytest.fixture
def out(tmp_path: Path, perfect: dict[str, Any]) -> Path:
    """Return a folder with predictions wherever a run would replace them, and a link to it."""
    folder = tmp_path / "out"
    (folder / "clouds" / "deep").mkdir(parents=True)
    path = write_predictions(folder / "clouds" / "deep" / "p.npz", "made-retrieval", **perfect)
    for name in ("alignment.json", "result.json", "mine.npz"):
        shutil.copy(path, folder / name)
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    (tmp_path / "p.npz").symlink_to(path)
    return folder


def test_predictions_in_what_a_run_replaces_are_refused(out: Path, data: Path) -> None:
    for given in (
        *("out/clouds/deep/p.npz", "out/clouds", "out/alignment.json", "out/result.json"),
        *("link/clouds/deep/p.npz", "p.npz"),
    ):
        for place in ("out", "link"):
            with pytest.raises(UsageError, match="--out"):
                check_run_folder(out.parent / place, out.parent / given)
    run = evaluate(out / "clouds" / "deep" / "p.npz", data=data)
    with pytest.raises(UsageError, match="clouds"):
        save(run, out)


def test_a_folder_that_no_run_wrote_stays(
    out: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask = ("eval", "retrieval", out / "mine.npz", "--data", data, "--out", out)
    (out / "result.json").unlink()
    there = files_below(out)
    assert run_main(*ask) == 2
    said = capsys.readouterr().err
    assert "clouds" in said
    assert files_below(out) == there
    shutil.rmtree(out / "clouds")
    assert run_main(*ask) == 0
    assert files_below(out) == {"result.json", "records.csv", "mine.npz"}
