"""What a user's mistake gets: one message, exit code 2, and nothing half-written.

Each case makes a bad file, runs a command as its entry point does, and names the fragments that
the message must hold: which file, which field, which rows, what was expected and how to fix it.
"""

from __future__ import annotations

import io
import json
import tomllib
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from airzoo_bench.core.files import fingerprint
from tests.support import MadeScene, files_below, run_main, write_predictions

Arrays = dict[str, Any]
Make = Callable[[Path, Arrays], object]


def changed(**changes: Any) -> Make:
    """Make predictions with some fields changed; a field is left out where None."""

    def make(path: Path, arrays: Arrays) -> None:
        fields = {"protocol": "made-retrieval"} | arrays | changes
        np.savez(path, **{k: np.array(v) for k, v in fields.items() if v is not None})

    return make


def edited(field: str, edit: Callable[[Any], Any]) -> Make:
    """Make predictions with one field edited in place, or replaced by what `edit` returns."""

    def make(path: Path, arrays: Arrays) -> None:
        array = np.array(arrays[field])
        array = array.astype("<U60") if array.dtype.kind == "U" else array
        result = edit(array)
        changed(**{field: array if result is None else result})(path, arrays)

    return make


def put(index: Any, value: Any) -> Callable[[Any], None]:
    """Return an edit that sets some entries."""

    def edit(array: Any) -> None:
        array[index] = value

    return edit


def described(**changes: Any) -> Make:
    """Make predictions by descriptors, with some fields changed."""

    def make(path: Path, arrays: Arrays) -> None:
        fields = {
            "query_ids": arrays["query_ids"],
            "ranked_ids": None,
            "query_descriptors": np.eye(10, 8, dtype=np.float32),
            "gallery_ids": arrays["gallery_ids"],
            "gallery_descriptors": np.ones((20, 8), np.float32),
        }
        changed(**(fields | changes))(path, {})

    return make


def with_nan(rows: int, bad: list[int], value: float = np.nan) -> Any:
    array = np.ones((rows, 8), np.float32)
    array[bad, 3] = value
    return array


def raw(content: bytes) -> Make:
    return lambda path, _: path.write_bytes(content)


def cut(path: Path, arrays: Arrays) -> None:
    changed()(path, arrays)
    path.write_bytes(path.read_bytes()[:-200])


def with_member(name: str, content: bytes) -> Make:
    def make(path: Path, arrays: Arrays) -> None:
        changed()(path, arrays)
        with warnings.catch_warnings(), zipfile.ZipFile(path, "a") as archive:
            warnings.simplefilter("ignore")  # of a name that there is already
            archive.writestr(name, content)

    return make


def lying(shape: tuple[int, ...], descr: str = "<f4") -> bytes:
    """Return an npy member whose header claims a shape and that holds no data."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": descr, "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def parquet(**columns: Any) -> Make:
    def make(path: Path, arrays: Arrays) -> None:
        import pandas as pd

        fields = {"query_ids": arrays["query_ids"], "ranked_ids": arrays["ranked_ids"]} | columns
        pd.DataFrame({k: v for k, v in fields.items() if v is not None}).to_parquet(
            path.with_suffix(".parquet")
        )

    return make


def npy_bytes(array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


IN_IDS, IN_RANKS = "p.npz, field 'query_ids'", "p.npz, field 'ranked_ids'"

CASES: dict[str, tuple[Make, list[str]]] = {
    "not there": (lambda path, _: None, ["p.npz: no such prediction file"]),
    "empty": (raw(b""), ["p.npz: not an npz file: it is empty", "numpy.savez", "template"]),
    "a csv": (raw(b"query,tile\n"), ["it begins with the bytes 71 75 65", "numpy.savez"]),
    "one npy": (raw(npy_bytes(np.ones(3))), ["looks like a single .npy array", "numpy.savez"]),
    "a pickle": (raw(b"\x80\x04\x95"), ["looks like a Python pickle"]),
    "hdf5": (raw(b"\x89HDF\r\n\x1a\n"), ["looks like an HDF5 file"]),
    "truncated": (cut, ["p.npz: not an npz file", "cut off", "numpy.savez"]),
    "another zip": (with_member("readme.txt", b"hi"), ["member 'readme.txt' is not an array"]),
    "member twice": (
        with_member("query_ids.npy", npy_bytes(np.array(["east/a"]))),
        ["holds the member 'query_ids.npy' 2 times"],
    ),
    "path as member": (
        with_member("../../x.npy", npy_bytes(np.ones(1))),
        ["fields that are not read here: '../../x'", "only protocol, query_ids, ranked_ids"],
    ),
    "terminal codes in a field's name": (
        with_member("\x1b[2J\nfake.npy", npy_bytes(np.ones(1))),
        [r"'\x1b[2J\nfake'"],
    ),
    "pickled ids": (
        edited("query_ids", lambda a: a.astype(object)),
        ["p.npz: field 'query_ids' holds pickled Python objects, which are never loaded", "dtype="],
    ),
    "half of the descriptors": (
        described(gallery_ids=None, gallery_descriptors=None),
        ["lacks the fields gallery_descriptors, gallery_ids (it has: protocol, query_desc"],
    ),
    "header lies": (
        with_member("scores.npy", lying((1 << 40, 1 << 20))),
        ["field 'scores' is damaged", "claims 4,611,686,018,427,387,904 bytes", "holds 0"],
    ),
    "impossible shape": (
        with_member("scores.npy", lying((0, 1 << 70))),
        ["field 'scores' is damaged or cut off: its header claims the shape and type"],
    ),
    "text of no width": (
        with_member("scores.npy", lying((10**15,), "<U0")),
        ["field 'scores' is damaged", "1000000000000000"],
    ),
    "no ids": (changed(query_ids=None), ["lacks the field query_ids (it has: protocol, ranked"]),
    "no claim": (changed(ranked_ids=None), ["lacks the field ranked_ids", "or with gallery_"]),
    "misspelt field": (
        changed(score=np.ones((10, 8))),
        ["p.npz: has fields that are not read here: 'score'", "only", "misspelt"],
    ),
    "gallery beside ranks": (changed(gallery_ids=["east/t"]), ["not read here: 'gallery_ids'"]),
    "both claims": (
        changed(query_descriptors=np.ones((10, 2))),
        ["both ranked_ids and query_descriptors", "keep one"],
    ),
    "ids are numbers": (
        changed(query_ids=np.arange(10)),
        ["field 'query_ids' is int64 of shape (10,)", "text with 1 dimension", "dtype=str"],
    ),
    "ranks are one list": (
        edited("ranked_ids", lambda a: a[:, 0]),
        ["field 'ranked_ids' is <U60 of shape (10,)", "text with 2 dimensions"],
    ),
    "one id, not a list": (
        changed(query_ids="east/q00000"),
        ["field 'query_ids' is <U11 of shape ()"],
    ),
    "rows do not fit": (
        edited("query_ids", lambda a: a[:7]),
        ["field 'ranked_ids' has 10 rows, 'query_ids' has 7", "same order"],
    ),
    "structured": (
        edited("query_ids", lambda a: np.zeros(10, [("a", "f4"), ("b", "i4")])),
        ["field 'query_ids' has dtype [('a', '<f4'), ('b', '<i4')]", "numbers or text"],
    ),
    "bytes, not UTF-8": (
        changed(query_ids=np.array([b"east/\xff"] * 10)),
        ["field 'query_ids' holds bytes that are not UTF-8", "dtype=str"],
    ),
    "control characters": (
        edited("query_ids", put([1, 3, 4, 8], "east/\x1b[31mred\nairzoo-bench: all is well")),
        [IN_IDS, "characters that do not print", "4 of 10 rows (first 3: 1, 3, 4)", "printable"],
    ),
    "NUL in an id": (
        edited("ranked_ids", put((2, 0), "east/t\x00x")),
        [IN_RANKS, "characters that do not print in 1 of 10 rows (2), counted from 0"],
    ),
    "turned writing": (
        edited("query_ids", put(5, "east/\u202egpj.exe")),
        [IN_IDS, "characters that do not print in 1 of 10 rows (5)"],
    ),
    "endless id": (
        changed(query_ids=["east/" + "x" * 5000] + [f"east/{i}" for i in range(9)]),
        [IN_IDS, "more than 256 characters in 1 of 10 rows (0)"],
    ),
    "no queries": (
        changed(query_ids=np.zeros(0, "<U9"), ranked_ids=np.zeros((0, 8), "<U9")),
        [IN_IDS, "holds no id", "ids such as"],
    ),
    "no columns": (
        changed(ranked_ids=np.zeros((10, 0), "<U9")),
        [IN_RANKS, "ranks only 0 tiles a query", "at least 5"],
    ),
    "empty ids": (
        edited("query_ids", put([0, 3], ["", "east/"])),
        [IN_IDS, "ids without a scene or a name: 2 of 10 ('', 'east/')", "scene/name"],
    ),
    "repeated queries": (
        edited("query_ids", put([1, 2, 5, 7, 8], "east/q00000")),
        [IN_IDS, "ids more than once: 1 of 5 (east/q00000)", "each id once"],
    ),
    "K too small": (
        edited("ranked_ids", lambda a: a[:, :4]),
        [IN_RANKS, "ranks only 4 tiles a query", "at least 5", "write more"],
    ),
    "repeated tiles": (
        edited("ranked_ids", lambda a: np.where(np.eye(10, 8, 7) > 0, a[:, :1], a)),
        [IN_RANKS, "more than once", "1 of 10 queries (east/q00000)", "first repeats east/t00000"],
    ),
    "gap": (
        edited("ranked_ids", put(([1, 2], [3, 0]), "")),
        [IN_RANKS, "an empty id before a tile", "2 of 10 queries (east/q00001, east/q00002)"],
    ),
    "tiles of another scene": (
        edited("ranked_ids", put((3, 1), "west/t00001")),
        [IN_RANKS, "scene east", "east/q00003", "the first is 'west/t00001'", "own scene only"],
    ),
    "strange tile": (
        edited("ranked_ids", put((3, 1), "east/512_9_9")),
        [IN_RANKS, "east/512_9_9", "ids such as east/t00000", "tiles.parquet"],
    ),
    "NaN scores": (
        changed(scores=np.where(np.eye(10, 8) > 0, np.nan, 1.0)),
        [
            "p.npz, field 'scores': NaN or infinite",
            "8 of 10 queries (first 3: east/q00000",
            "finite",
        ],
    ),
    "scores of another shape": (
        changed(scores=np.ones((10, 7))),
        ["field 'scores' has shape (10, 7)", "(10, 8)"],
    ),
    "scores as text": (
        changed(scores=np.full((10, 8), "high")),
        ["field 'scores' is <U4 of shape (10, 8)", "floating point"],
    ),
    "scores out of order": (
        changed(scores=np.vstack([np.tile(np.arange(8.0, 0, -1), (9, 1)), [np.arange(8.0)]])),
        ["p.npz", "scores are not in order", "west/q00003", "never rise", "sort"],
    ),
    "NaN descriptors of queries": (
        described(query_descriptors=with_nan(10, [2, 3, 4, 5])),
        [
            "p.npz",
            "query_descriptors",
            "NaN or infinite",
            "4 of 6 (first 3: east/q00002",
            "finite",
        ],
    ),
    "infinite descriptors of tiles": (
        described(gallery_descriptors=with_nan(20, [1], -np.inf)),
        ["p.npz", "gallery_descriptors", "NaN or infinite", "finite numbers"],
    ),
    "other dimensions": (
        described(query_descriptors=np.ones((10, 7), np.float32)),
        ["query descriptors have 7 dimensions, gallery descriptors 8", "same model"],
    ),
    "integer descriptors": (
        described(query_descriptors=np.ones((10, 8), np.uint8)),
        ["field 'query_descriptors' is uint8 of shape (10, 8)", "floating point", "np.float32"],
    ),
    "no dimensions": (
        described(query_descriptors=np.ones((10, 0), np.float32)),
        ["field 'query_descriptors' is float32 of shape (10, 0)"],
    ),
    "part of the gallery": (
        described(
            gallery_ids=[f"east/t{i:05d}" for i in range(11)],
            gallery_descriptors=np.ones((11, 8), np.float32),
        ),
        ["p.npz, field 'gallery_ids'", "of scene east: 1 of 12 (east/t00011)", "every tile"],
    ),
    "ids of another benchmark": (
        edited("query_ids", lambda a: np.char.add("04/", np.arange(10).astype(str))),
        [IN_IDS, "none of its query ids belongs to made", "uav-visloc-retrieval", "east/q00000"],
    ),
    "ids of another split": (
        edited("query_ids", lambda a: np.char.add("east/DJI_", np.arange(10).astype(str))),
        [IN_IDS, "10 of 10 (first 3: east/DJI_0, ", "ids such as east/q00000"],
    ),
    "no protocol": (
        changed(protocol=None),
        ["p.npz: does not say which protocol it is for", "--protocol"],
    ),
    "misspelt protocol": (
        changed(protocol="made-retreival"),
        [
            "p.npz, field 'protocol': unknown protocol 'made-retreival'",
            "(did you mean 'made-retrieval'",
            "protocols` lists",
        ],
    ),
    "protocol is a number": (changed(protocol=7), ["field 'protocol' is int64 of shape ()"]),
    "protocol is a path": (
        changed(protocol="../../evil.toml"),
        ["field 'protocol' is '../../evil.toml', which is no protocol's name", "--protocol"],
    ),
    "benchmark is not there": (
        changed(protocol="airzoo-real-retrieval"),
        ["benchmark airzoo-real is not there", "found: made", "--data", "prepare"],
    ),
    "parquet: unknown column": (
        parquet(score=[1.0] * 10),
        ["p.parquet: has unknown columns: 1 ('score')", "only protocol, query_ids", "rename"],
    ),
    "parquet: two protocols": (
        parquet(protocol=["made-retrieval"] * 9 + ["other"]),
        ["p.parquet: column 'protocol' names 2 ('made-retrieval', 'other')", "every row"],
    ),
    "parquet: ragged": (
        parquet(ranked_ids=[["east/t00001"] * n for n in range(1, 11)]),
        ["column 'ranked_ids' has lists of 1 to 10 entries", "one length", "fill shorter"],
    ),
    "parquet: null": (
        parquet(query_ids=["east/q00000", None, None, None, None] + ["east/q00001"] * 5),
        ["column 'query_ids' has nulls in rows, counted from 0: 4 (first 3: 1, 2, 3)"],
    ),
    "parquet: no ranks": (parquet(ranked_ids=None), ["lacks the field ranked_ids"]),
    "parquet: numbers as ids": (
        parquet(query_ids=list(range(10))),
        ["field 'query_ids' is int64 of shape (10,)", "text with 1 dimension"],
    ),
}


@pytest.fixture
def arrays(perfect: Arrays, scenes: list[MadeScene]) -> Arrays:
    return perfect | {"gallery_ids": [tile for scene in scenes for tile in scene.tile_ids]}


def prediction_file(folder: Path, make: Make, arrays: Arrays) -> Path:
    path = folder / "p.npz"
    fields = {key: arrays[key] for key in ("query_ids", "ranked_ids", "gallery_ids")}
    gallery = fields.pop("gallery_ids")
    needs_gallery = make.__qualname__.startswith("described")
    make(path, fields | ({"gallery_ids": gallery} if needs_gallery else {}))
    return path if not path.with_suffix(".parquet").exists() else path.with_suffix(".parquet")


@pytest.mark.parametrize("case", list(CASES))
def test_bad_predictions(
    case: str, data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    make, fragments = CASES[case]
    path = prediction_file(tmp_path, make, arrays)
    before = files_below(tmp_path)
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out") == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    assert "\x1b" not in message
    assert "\n  expected: " in message or "\n  fix:      " in message
    assert len(message) < 2000
    for fragment in fragments:
        assert fragment in message
    assert files_below(tmp_path) == before


@pytest.mark.parametrize("case", list(CASES))
def test_check_finds_what_eval_refuses(
    case: str, data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    path = prediction_file(tmp_path, CASES[case][0], arrays)
    code = run_main("check", path)
    message = capsys.readouterr().err
    assert code in (1, 2), message
    assert "Traceback" not in message


def test_check_lists_everything_and_exits_1(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = np.array(arrays["query_ids"])
    ids[1] = ids[0]
    ranked = np.array(arrays["ranked_ids"])[:, :4]
    ranked[2, 0] = ranked[2, 1]
    ranked[3, 0] = "west/t00000"
    ranked[4, 2] = ""
    scores = np.tile([4.0, 3, 2, 1], (10, 1))
    scores[5] = scores[5, ::-1]
    scores[6, 1] = np.inf
    path = tmp_path / "p.npz"
    changed(query_ids=ids, ranked_ids=ranked, scores=scores)(path, {})
    assert run_main("check", path) == 1
    out, message = capsys.readouterr()
    assert out == ""
    for finding in (
        "ids more than once",
        "ranks only 4 tiles",
        "an empty id before a tile",
        "a tile is ranked more than once",
        "tiles of another scene are ranked for 1 of 10 queries (east/q00003); the first is",
        "NaN or infinite scores",
        "scores are not in order for 2 of 10 queries (east/q00005",
    ):
        assert message.count(finding) == 1, finding


def test_check_names_descriptors_that_are_not_finite(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    make = described(
        query_descriptors=with_nan(10, [1]), gallery_descriptors=with_nan(20, [0, 13], np.inf)
    )
    assert run_main("check", prediction_file(tmp_path, make, arrays)) == 1
    message = capsys.readouterr().err
    assert "field 'query_descriptors': NaN or infinite descriptors: 1 of 10 (east/q00001)" in (
        message
    )
    assert "descriptors: 2 of 20 (east/t00000, west/t00001)" in message


@pytest.mark.parametrize(
    ("case", "code"),
    [
        *[(case, 2) for case in ("not there", "empty", "a csv", "a pickle", "truncated")],
        *[(case, 1) for case in ("K too small", "repeated queries", "control characters")],
    ],
)
def test_check_tells_what_is_wrong_from_what_is_no_prediction(
    case: str, code: int, data: Path, tmp_path: Path, arrays: Arrays
) -> None:
    assert run_main("check", prediction_file(tmp_path, CASES[case][0], arrays)) == code


@pytest.mark.parametrize(
    ("fields", "options", "code"),
    [
        ({}, [], 0),
        ({"centers": np.zeros(3)}, [], 1),
        ({"ranked_ids": "east/t00000"}, [], 1),
        ({"ranked_ids": np.zeros((10, 8))}, [], 1),
        ({"query_ids": None}, [], 1),
        ({"protocol": np.zeros(3)}, [], 1),
        ({"protocol": "a/b.toml"}, [], 1),
        ({"protocol": "unknown"}, [], 2),
        ({"protocol": None}, [], 2),
        ({}, ["--protocol", "unknown"], 2),
        ({}, ["--data", "nowhere"], 2),
        ({}, ["--max-memory", "much"], 2),
    ],
)
def test_exit_codes_of_check(
    fields: Arrays, options: list[str], code: int, data: Path, tmp_path: Path, arrays: Arrays
) -> None:
    path = prediction_file(tmp_path, changed(**fields), arrays)
    assert run_main("check", path, *options) == code


def test_check_of_a_good_file_exits_0(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    for make in (changed(), described(), parquet(protocol="made-retrieval")):
        assert run_main("check", prediction_file(tmp_path, make, arrays)) == 0
    changed()(tmp_path / "p.npz", {k: arrays[k] for k in ("query_ids", "ranked_ids")})
    assert run_main("check", tmp_path / "p.npz") == 0
    assert "nothing wrong was found" in capsys.readouterr().out


def test_check_says_which_benchmark_the_ids_look_like(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = [f"City/{i}" for i in range(3)]
    ranked = [[f"City/t{k}" for k in range(5)]] * 3
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", query_ids=ids, ranked_ids=ranked)
    assert run_main("check", path) == 1
    assert "they look like those of airzoo-real-" in capsys.readouterr().err


@pytest.mark.parametrize("ids", [["east/nobody"], ["east/q00000.JPG"]])
def test_check_refuses_what_eval_refuses(
    ids: list[str], data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ranked = [[f"east/t{k:05d}" for k in range(5)]]
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", query_ids=ids, ranked_ids=ranked)
    for command, code in ((("eval", "retrieval"), 2), (("check",), 1)):
        assert run_main(*command, path) == code
        message = capsys.readouterr().err
        assert "none of its query ids belongs to made" in message
        assert ("leave out the file's ending" in message) == ids[0].endswith(".JPG")


@pytest.mark.parametrize("scene", ["EAST", "East"])
def test_a_scene_by_its_title_is_told_how_it_is_written(
    scene: str, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = {"query_ids": [f"{scene}/q00000"], "ranked_ids": [[f"east/t{k:05d}" for k in range(5)]]}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **given)
    said = []
    for command, code in ((("eval", "retrieval"), 2), (("check",), 1)):
        assert run_main(*command, path) == code
        said.append(capsys.readouterr().err.removeprefix("airzoo-bench: "))
    assert said[0] == said[1]
    assert f"write the scene as the protocol does: east for {scene}" in said[0]
    assert "ids such as east/q00000" in said[0]
    assert "name the right protocol" not in said[0]


def test_check_refuses_tiles_that_are_not_in_the_gallery(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    ranked = np.array(arrays["ranked_ids"])
    ranked[0, 0] = "east/t99999"
    given = {"query_ids": arrays["query_ids"], "ranked_ids": ranked}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **given)
    for command, code in ((("eval", "retrieval"), 2), (("check",), 1)):
        assert run_main(*command, path) == code
        assert "the first is 'east/t99999'" in capsys.readouterr().err


def test_check_tells_of_missing_queries_and_of_an_absent_benchmark(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    given = {key: arrays[key][:3] for key in ("query_ids", "ranked_ids")}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **given)
    assert run_main("check", path) == 0
    message = capsys.readouterr().err
    assert "queries that the predictions lack, scored at their worst: 7 of 10 (first 3: " in message
    protocol = data / "made" / "protocols" / "made-retrieval.toml"
    assert run_main("check", path, "--protocol", protocol, "--data", tmp_path) == 0
    assert "predictions were not compared with the benchmark" in capsys.readouterr().err


OF_TRACKS = {
    "retrieval": ("uav-visloc-retrieval", ["p.npz", "p.parquet"]),
    "matching": ("photos-matching", ["p.npz", "p.txt"]),
    "reconstruction": ("photos-reconstruction", ["p.npz", "p.ply", "p.laz", "p.zip", "p"]),
}
"""A protocol of each track, and what its predictions come as; names without ending are folders."""


@pytest.mark.parametrize("asked", OF_TRACKS)
@pytest.mark.parametrize("own", OF_TRACKS)
def test_predictions_of_another_track_are_told_their_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: str, own: str
) -> None:
    protocol, names = OF_TRACKS[own]
    for name in names:
        path = tmp_path / name
        if path.suffix == ".npz":
            np.savez(path, protocol=protocol)
        elif path.suffix:
            path.write_text("ply")
        else:
            path.mkdir()
            (path / "protocol.txt").write_text(protocol)
        assert run_main("eval", asked, path, "--data", tmp_path) == 2
        told = f"airzoo-bench eval {own} {path}" in capsys.readouterr().err
        assert told == (asked != own), name


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
        ["eval", "retrieval", "p.csv"],
        ["unknown kind of prediction file '.csv'", ".npz or"],
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
    "no such protocol file": (
        ["protocols", "none.toml"],
        ["none.toml: no such protocol file"],
    ),
    "template without ending": (
        ["template", "made-retrieval", "--out", "x"],
        ["x: templates are written as .npz", "name it x.npz"],
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


def resealed(path: Path, edit: Callable[[Any], None]) -> None:
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
        lambda p: resealed(p, lambda c: c.update(best=True)),
        ["unknown key 'best'"],
    ),
    "a scene without counts": (
        lambda p: resealed(p, pop("counts", "east")),
        ["not a result", "counts, titles and scores are not of the same scenes"],
    ),
    "a score missing": (
        lambda p: resealed(p, pop("overall", "recall@1")),
        ["scores do not fit the columns: ['recall@1']"],
    ),
    "NaN": (
        lambda p: resealed(p, lambda c: c["overall"].update({"recall@1": "NaN"})),
        ["key 'overall.recall@1'", "a score is never NaN"],
    ),
    "two protocols": (
        lambda p: resealed(p, other_protocol),
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
