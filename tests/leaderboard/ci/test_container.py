"""The container of the workflows, in which a child reads what strangers wrote."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.sandbox import Limits, call_limited

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[3]
WORKFLOW = ROOT / "airzoo_bench/leaderboard/starter/leaderboard.yml"


def look(path: str, other: str) -> list[str]:
    """Return what a child sees: of the predictions, of another file, of the network, of secrets."""
    import os
    import socket

    seen = [Path(path).read_text(), "other" if Path(other).exists() else "", *os.environ]
    return [*seen, *(name for _, name in socket.if_nameindex() if name != "lo")]


def test_the_container_of_the_workflows_reads_predictions_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = yaml.safe_load(WORKFLOW.read_text())["env"]["AIRZOO_BENCH_CONTAINER"]
    # Where the programs of this machine lie, which on GitHub are in /usr and /opt.
    base = Path(sys.executable).resolve().parents[1]
    places = {sys.prefix, str(base), sysconfig.get_paths()["purelib"], str(ROOT / "airzoo_bench")}
    mounts = " ".join(f"--ro-bind {place} {place}" for place in [*sorted(places), ROOT / "tests"])
    command = command.replace("--tmpfs /tmp", f"--tmpfs /tmp {mounts}")
    if shutil.which("bwrap") is None:
        pytest.skip("bwrap is not installed (Debian: bubblewrap)")
    works = subprocess.run(["bwrap", "--unshare-all", "--ro-bind", "/", "/", "true"], check=False)
    if works.returncode:
        pytest.skip("this system lets bwrap make no namespaces")
    predictions, other, work = tmp_path / "preds", tmp_path / "other", tmp_path / "work"
    predictions.write_text("predictions")
    other.write_text("secret")
    work.mkdir()
    monkeypatch.setenv("AIRZOO_BENCH_CONTAINER", command)
    for name in ("GIT_TOKEN", "AIRZOO_BENCH_KEY"):
        monkeypatch.setenv(name, "secret")
    seen = call_limited(
        f"{__name__}:look",
        {"path": str(predictions), "other": str(other)},
        where=predictions,
        limits=Limits(1 << 30),
        folder=work,
    )
    assert seen[:2] == ["predictions", ""]
    assert not {"GIT_TOKEN", "AIRZOO_BENCH_KEY", "eth0"} & set(seen)
    with pytest.raises(PredictionError, match="FileNotFoundError"):
        call_limited(
            f"{__name__}:look",
            {"path": str(other), "other": str(other)},
            where=predictions,
            limits=Limits(1 << 30),
            folder=work,
        )
