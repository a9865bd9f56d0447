"""What mistakes in options, results and benchmark folders get: one message and exit code 2."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from airzoo_bench.core.files import fingerprint
from tests.cli.bad_predictions import Arrays, changed
from tests.support import files_below, run_main

GOOD = "GOOD"  # stands for a good prediction file
OPTIONS: dict[str, tuple[list[str], list[str]]] = {
    "no such data": (
        ["eval", "retrieval", GOOD, "--data", "nowhere"],
        ["--data nowhere: no such folder", "benchmark folder", "prepare"],
    ),
    "no memory": (
        ["eval", "retrieval", GOOD, "--max-memory", "nonsense"],
        ["--max-memory 'nonsense' is not a size", "512M or 4G"],
    ),
    "zero memory": (
        ["check", GOOD, "--max-memory", "0"],
        ["--max-memory '0' is not a size"],
    ),
    "too little memory": (
        ["eval", "retrieval", GOOD, "--max-memory", "1K"],
        ["query_ids", "more than the limit", "at most 1,024 bytes", "raise --max-memory"],
    ),
    "a folder as predictions": (
        ["eval", "retrieval", "."],
        [".: a folder, as predictions of the reconstruction track are", ".npz"],
    ),
    "another ending": (
        ["eval", "retrieval", "p.dat"],
        ["unknown kind of prediction file '.dat'", ".npz"],
    ),
    "no file and no ending, to be checked": (
        ["check", "nothing", "--protocol", "made-retrieval"],
        ["nothing: no such prediction file"],
    ),
    "ending of another track": (
        ["eval", "retrieval", "p.csv"],
        ["p.csv: a .csv file, as predictions of the reconstruction track are"],
    ),
    "a file that is not there": (
        ["eval", "retrieval", "q.dat"],
        ["q.dat: no such prediction file"],
    ),
    "output below a file": (
        ["eval", "retrieval", GOOD, "--out", "p.npz/deep/out"],
        ["p.npz: a file, not a folder", "name a folder"],
    ),
    "output is a file": (
        ["eval", "retrieval", GOOD, "--out", "p.npz"],
        ["p.npz: a file, not a folder"],
    ),
    "unknown protocol": (
        ["eval", "retrieval", GOOD, "--protocol", "uav-visloc"],
        ["unknown protocol 'uav-visloc' (did you mean 'uav-visloc-retrieval'", "one of: "],
    ),
    "a protocol of another track": (
        ["eval", "matching", GOOD, "--protocol", "airzoo-mini-matching"],
        [
            "p.npz: is for made-retrieval, of the retrieval track; --protocol airzoo-mini-matching",
            "leave out --protocol: airzoo-bench eval retrieval p.npz",
        ],
    ),
    "no such protocol file": (
        ["protocols", "none.toml"],
        ["none.toml: no such protocol file"],
    ),
    "template without ending": (
        ["template", "made-retrieval", "--out", "x"],
        ["x: predictions are written as .npz", "name it x.npz"],
    ),
    "template is a folder": (
        ["template", "made-retrieval", "--out", "folder.npz"],
        ["folder.npz: a folder, not a file"],
    ),
    "template of what is not there": (
        ["template", "uav-visloc-retrieval"],
        ["benchmark uav-visloc is not there", "found: made"],
    ),
    "baseline without photos": (
        ["baseline", "retrieval", "made-retrieval"],
        ["dom.tif: no such file"],
    ),
    "baseline without ending": (
        ["baseline", "retrieval", "made-retrieval", "--out", "x"],
        ["x: predictions are written as .npz"],
    ),
    "no result": (["table", "none.json"], ["none.json: no such result file"]),
    "a folder as result": (["table", "folder.npz"], ["folder.npz: a folder, not a result file"]),
}


@pytest.mark.parametrize("case", list(OPTIONS))
def test_bad_options(
    case: str,
    data: Path,
    tmp_path: Path,
    arrays: Arrays,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arguments, fragments = OPTIONS[case]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    for other in ("p.dat", "p.csv"):
        (tmp_path / other).touch()
    changed()(tmp_path / "p.npz", {k: arrays[k] for k in ("query_ids", "ranked_ids")})
    before = files_below(tmp_path)
    assert run_main(*("p.npz" if a is GOOD else a for a in arguments)) == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    for fragment in fragments:
        assert fragment in message
    assert files_below(tmp_path) == before


def scored(folder: Path, arrays: Arrays, method: str, *more: str) -> Path:
    path = folder / f"{method}.npz"
    changed()(path, {k: arrays[k] for k in ("query_ids", "ranked_ids")})
    assert run_main("eval", "retrieval", path, "--out", folder / method, *more) == 0
    return folder / method / "result.json"


def rewritten(path: Path, edit: Callable[[Any], None]) -> None:
    """Edit a result and give it a checksum that fits, as anybody can."""
    content = json.loads(path.read_text())
    edit(content)
    del content["checksum"]
    path.write_text(json.dumps(content | {"checksum": fingerprint(content)}))


def pop(*keys: str) -> Callable[[Any], None]:
    def edit(content: Any) -> None:
        for key in keys[:-1]:
            content = content[key]
        content.pop(keys[-1])

    return edit


def other_protocol(content: Any) -> None:
    content["protocol"]["fingerprint"] = "0" * 64


RESULTS: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "changed by hand": (
        lambda p: p.write_text(p.read_text().replace('"recall@1": 1.0', '"recall@1": 0.9')),
        ["result.json: its content was changed", "checksum does not fit", "score", "again"],
    ),
    "not JSON": (
        lambda p: p.write_text("{"),
        ["result.json: not a result", "not valid JSON: EOF", "airzoo-bench eval ... --out DIR"],
    ),
    "not text": (lambda p: p.write_bytes(b"\xff\xfe"), ["not text: byte 0 is not UTF-8"]),
    "other JSON": (lambda p: p.write_text("[1]"), ["result.json: not a result of this version"]),
    "a key too many": (
        lambda p: rewritten(p, lambda c: c.update(best=True)),
        ["unknown key 'best'"],
    ),
    "a scene without counts": (
        lambda p: rewritten(p, pop("counts", "east")),
        ["not a result", "counts, titles and scores are not of the same scenes"],
    ),
    "a score missing": (
        lambda p: rewritten(p, pop("overall", "recall@1")),
        ["scores do not fit the columns: ['recall@1']"],
    ),
    "NaN": (
        lambda p: rewritten(p, lambda c: c["overall"].update({"recall@1": "NaN"})),
        ["key 'overall.recall@1'", "a score is never NaN"],
    ),
    "two protocols": (
        lambda p: rewritten(p, other_protocol),
        ["made with different protocols", "and 000000000000)", "one protocol: a difference"],
    ),
}


@pytest.mark.parametrize("case", list(RESULTS))
def test_bad_results(
    case: str, data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    change, fragments = RESULTS[case]
    one, two = scored(tmp_path, arrays, "one"), scored(tmp_path, arrays, "two")
    assert run_main("table", one, two, "--scene", "east") == 0
    change(two)
    capsys.readouterr()
    assert run_main("table", one, two) == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    for fragment in fragments:
        assert fragment in message


def test_an_unknown_scene_of_a_table(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", scored(tmp_path, arrays, "one"), "--scene", "eats") == 2
    message = capsys.readouterr().err
    assert "no scene 'eats' in the results (did you mean 'east'?)" in message
    assert "expected: one of east, west" in message


BENCHMARKS: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "no benchmark.toml": (
        lambda f: (f / "benchmark.toml").unlink(),
        ["made: no benchmark folder here", "a folder with benchmark.toml", "--data"],
    ),
    "not TOML": (
        lambda f: (f / "benchmark.toml").write_text("name = 1\nname = 2\n"),
        ["benchmark.toml: not valid TOML", "line 2", "a benchmark file"],
    ),
    "no truth": (
        lambda f: (f / "scenes/west/retrieval/positives.npz").unlink(),
        [
            "west/retrieval/positives.npz: a file of the benchmark is missing",
            "prepare the benchmark again",
        ],
    ),
    "changed truth": (
        lambda f: (f / "scenes/west/queries.csv").write_text("id,image\n"),
        ["west/queries.csv: a file of the benchmark was changed", "SHA-256", "prepare"],
    ),
    "truth without checksum": (
        lambda f: edit_toml(f, lambda v: v["checksums"].pop("scenes/east/retrieval/positives.npz")),
        [
            "east/retrieval/positives.npz: has no checksum in benchmark.toml",
            "prepare the benchmark again",
        ],
    ),
    "unknown key": (
        lambda f: edit_toml(f, lambda v: v.update(vresion=2)),
        ["benchmark.toml: unknown key 'vresion' (did you mean 'version'?)"],
    ),
    "wrong type": (
        lambda f: edit_toml(f, lambda v: v.update(version="two")),
        ["benchmark.toml: key 'version' is 'two': ", "valid integer"],
    ),
    "another name": (
        lambda f: edit_toml(f, lambda v: v.update(name="other")),
        ["made: holds benchmark other, not made", "--data", "--protocol"],
    ),
    "a scene missing": (
        lambda f: edit_toml(f, lambda v: v["scenes"].pop(0)),
        ["made: lacks the scenes east of protocol made-retrieval"],
    ),
    "other settings": (
        lambda f: edit_toml(f, lambda v: v["tracks"]["retrieval"]["gallery"].update(overlap=0.25)),
        ["gallery.overlap: 0.25 in the folder, 0.5 in the protocol", "protocols/ folder"],
    ),
}


def edit_toml(folder: Path, edit: Callable[[Any], object]) -> None:
    path = folder / "benchmark.toml"
    values = tomllib.loads(path.read_text())
    edit(values)
    path.write_text(tomli_w.dumps(values))


@pytest.mark.parametrize("case", list(BENCHMARKS))
def test_bad_benchmarks(
    case: str, data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    change, fragments = BENCHMARKS[case]
    path = tmp_path / "p.npz"
    changed()(path, {k: arrays[k] for k in ("query_ids", "ranked_ids")})
    change(data / "made")
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out") == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    for fragment in fragments:
        assert fragment in message
    assert not (tmp_path / "out").exists()
