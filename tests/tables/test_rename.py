"""``--rename``: other names for methods, which may then share a row; and what is named wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.results.result import write_result
from airzoo_bench.tables.render import FORMATS
from tests.support import run_main
from tests.tables.two_results import made

OURS = ("--rename", "SIFT and VLAD=Ours", "--rename", "SIFT=Ours")


@pytest.fixture
def tracks(tmp_path: Path) -> list[Path]:
    """Write results of two benchmarks."""
    paths = []
    for name, benchmark in {"SIFT and VLAD": "a", "SIFT": "b", "Other": "b"}.items():
        one = made(name, {"City": {"recall@1": 0.5}, "Rural": {"recall@1": 0.25}})
        truth = one.truth.model_copy(update={"benchmark": benchmark})
        protocol = one.protocol.model_copy(update={"name": f"{benchmark}-protocol"})
        changes = {"truth": truth, "protocol": protocol}
        paths.append(tmp_path / f"{name}.json")
        write_result(paths[-1], one.model_copy(update=changes).with_checksum())
    return paths


@pytest.mark.parametrize("form", FORMATS)
def test_methods_of_one_name_share_a_row(
    form: str, tracks: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    options = (*OURS, "--baseline", "Other", "--format", form)
    assert run_main("table", *tracks, *options) == 0
    out, said = capsys.readouterr()
    assert "SIFT" not in out + said
    assert "difference from Other" in (out + said).replace(r" \\ ", " ")
    if form == "csv":
        assert "Ours,37.50,37.50,0.00" in out
    if form == "json":
        assert out.count('"Ours"') == 1


@pytest.mark.parametrize("text", ["MegaLok=X", "Other", "Other=", "=X"])
def test_what_is_no_renaming(
    text: str, tracks: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *tracks, "--rename", text) == 2
    message = capsys.readouterr().err
    for fragment in ("--rename", "OLD=NEW", "SIFT and VLAD, SIFT, Other"):
        assert fragment in message
