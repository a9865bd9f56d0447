"""What the command says of each prediction that is wrong."""

from __future__ import annotations

import numpy as np

from tests.cli.bad_predictions import (
    Make,
    changed,
    cut,
    described,
    edited,
    lying,
    npy_bytes,
    parquet,
    put,
    raw,
    with_member,
    with_nan,
)

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
        ["field 'scores' is damaged", "states 4,611,686,018,427,387,904 bytes", "holds 0"],
    ),
    "impossible shape": (
        with_member("scores.npy", lying((0, 1 << 70))),
        ["field 'scores' is damaged or cut off: its header states the shape and type"],
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
        ["holds ranked_ids and query_descriptors", "keep one"],
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
        [IN_RANKS],
    ),
    "empty ids": (
        edited("query_ids", put([0, 3], ["", "east/"])),
        [IN_IDS, "ids without a scene or a name: 2 of 10 ('', 'east/')", "scene/name"],
    ),
    "repeated queries": (
        edited("query_ids", put([1, 2, 5, 7, 8], "east/q00000")),
        [IN_IDS, "ids more than once: 1 of 5 (east/q00000)", "each id once"],
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
        ["field 'scores' is <U4 of shape (10, 8)"],
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
