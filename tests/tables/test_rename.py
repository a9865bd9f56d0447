"""``--rename``: other names for methods, scenes, benchmarks and scores; and what is named wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.results.result import write_result
from airzoo_bench.tables.render import FORMATS
from tests.support import run_main
from tests.tables.two_results import made

NAMES = ("--rename", "MegaLoc=Old Loc", "--rename", "City=Town", "--rename", "R@1=First")


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    for name in ("Mine", "MegaLoc"):
        scenes = {"City": {"recall@1": 0.5}, "Rural": {"recall@1": 0.25}}
        write_result(tmp_path / f"{name}.json", made(name, scenes))
    return [tmp_path / f"{name}.json" for name in ("Mine", "MegaLoc")]


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_shows_new_names(
    form: str, files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--layout", "scenes", "--queries", "--baseline", "MegaLoc", "--format", form)
    assert run_main("table", *files, *options, *NAMES) == 0
    out, said = capsys.readouterr()
    for new in ("Old Loc", "Town (161)", "First"):
        assert new in out
    for old in ("MegaLoc", "City", "R@1"):
        assert old not in out + said
    assert "difference from Old Loc, of the values as printed" in (out + said).replace(r" \\ ", " ")


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("MegaLok=X", ["called 'MegaLok'", "did you mean 'MegaLoc'?"]),
        ("MegaLoc", ["no new name", "OLD=NEW"]),
        ("MegaLoc=", ["new name is empty"]),
    ],
)
def test_what_is_no_renaming(
    text: str, fragments: list[str], files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *files, "--rename", text) == 2
    message = capsys.readouterr().err
    for fragment in ["--rename", *fragments]:
        assert fragment in message


class TestOneRow:
    """Results of several tracks that are renamed to one method."""

    OURS = ("--rename", "SIFT and VLAD=Ours", "--rename", "SIFT=Ours")

    @pytest.fixture
    def tracks(self, tmp_path: Path) -> list[Path]:
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
    def test_they_share_one(
        self, form: str, tracks: list[Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run_main("table", *tracks, *self.OURS, "--format", form) == 0
        out = capsys.readouterr().out
        assert "SIFT" not in out
        # A note names the method too.
        rows = [line for line in out.splitlines() if line.strip(' |"<tdr>').startswith("Ours")]
        rows = [line for line in rows if "A note" not in line and "note." not in line]
        assert len(rows) == 1 or form in ("html", "json")
        if form == "csv":
            assert rows == ["Ours,37.50,37.50"]
        if form == "json":
            assert out.count('"Ours"') == 1

    def test_marks_citations_and_gains_stay(
        self, tracks: list[Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        options = ("--highlight", "SIFT", "--baseline", "Other", "--cite", "SIFT=a")
        options += ("--cite", "SIFT and VLAD=b", "--format", "latex")
        assert run_main("table", *tracks, *self.OURS, *options) == 0
        out = capsys.readouterr().out
        assert r"\rowcolor{yellow!25}" + "\n" + r"Ours~\cite{b,a}" in out
        assert "{(0.00)}" in out or "(0.00)" in out or "(+0.00)" in out

    def test_two_numbers_do_not_fit_one_cell(
        self, tracks: list[Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run_main("table", *tracks, *self.OURS, "--rename", "Other=Ours") == 2
        message = capsys.readouterr().err
        assert "--rename: 2 rows that would become one, 'Ours', have b, R@1" in message
