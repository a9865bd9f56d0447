"""Predictions of the retrieval track, what its methods write, and its benchmark folder."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np

from tests.hostile.inputs.case import Input
from tests.hostile.mutations import Random, spoil_arrays, spoil_bytes, spoil_text
from tests.readers import retrieval_files
from tests.support import MadeScene, made_protocol, write_benchmark

__all__ = ["files", "of_methods"]


def files(home: Path) -> list[Input]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    scenes = [
        MadeScene("east", [[q, q + 1] for q in range(4)], 6, {"weather": ["rain", "sun"] * 2}),
        MadeScene("west", [[q] for q in range(3)], 5, {"altitude_m": [1.0, 2.0, 3.0]}),
    ]
    chosen = made_protocol(scenes)
    write_benchmark(home / "data" / "made", chosen, scenes)
    ids = [name for scene in scenes for name in scene.query_ids]
    ranked = [scene.tile_ids[:5] for scene in scenes for _ in scene.positives]
    scores = np.tile(np.linspace(1, 0.5, 5), (len(ids), 1))
    name = np.array(chosen.name)
    random = np.random.default_rng(0)
    tiles = [tile for scene in scenes for tile in scene.tile_ids]
    described = {
        "query_descriptors": random.random((len(ids), 3)),
        "gallery_ids": tiles,
        "gallery_descriptors": random.random((len(tiles), 3), np.float32),
    }
    given = home / "given"
    given.mkdir()
    np.savez(given / "ranked.npz", protocol=name, query_ids=ids, ranked_ids=ranked, scores=scores)
    np.savez(given / "described.npz", protocol=name, query_ids=ids, **described)
    columns = {"protocol": [chosen.name] * len(ids), "query_ids": ids, "ranked_ids": ranked}
    columns["scores"] = scores.tolist()
    pq.write_table(pa.table(columns), given / "ranked.parquet")
    pq.write_table(
        pa.table(columns), given / "plain.parquet", use_dictionary=False, row_group_size=3
    )
    read = (("eval", "retrieval", "FILE"), ("check", "FILE"))
    data = str(home / "data")
    made = [
        Input("retrieval/ranked npz", given, "ranked.npz", spoil_arrays, read, data),
        Input("retrieval/descriptors npz", given, "described.npz", spoil_arrays, read, data),
        Input("retrieval/parquet", given, "ranked.parquet", spoil_bytes, read, data),
        Input("retrieval/plain parquet", given, "plain.parquet", spoil_bytes, read, data),
    ]
    whole = home / "whole"
    shutil.copytree(home / "data", whole / "data")
    shutil.copy(given / "ranked.npz", whole)
    command = (("eval", "retrieval", "FOLDER/ranked.npz"), ("protocols",))
    place = "data/made/scenes/east"
    for name_, file, spoil in (
        ("benchmark.toml", "data/made/benchmark.toml", spoil_text),
        ("protocol", f"data/made/protocols/{chosen.name}.toml", spoil_text),
        ("queries.csv", f"{place}/queries.csv", spoil_text),
        ("footprints.csv", f"{place}/retrieval/footprints.csv", spoil_text),
        ("excluded.csv", f"{place}/retrieval/excluded.csv", spoil_text),
        ("positives.npz", f"{place}/retrieval/positives.npz", spoil_arrays),
        ("tiles.parquet", f"{place}/retrieval/tiles.parquet", _spoil_tiles),
    ):
        made.append(
            Input(f"folder/retrieval {name_}", whole, file, spoil, command[:1], "data", 0.7, True)
        )
    return made


def _spoil_tiles(random: Random, content: bytes) -> bytes:
    """Change values and types of a parquet table, or its bytes."""
    import pandas as pd

    if random.random() < 0.4:
        return spoil_bytes(random, content)
    table = pd.read_parquet(io.BytesIO(content))
    name = str(random.choice(table.columns.to_numpy()))
    match int(random.integers(6)):
        case 0:
            table = table.drop(columns=name)
        case 1:
            table[name] = table[name].astype(str).map(lambda text: text.encode() + b"\xff")
        case 2:
            table[name] = table[name].astype(str)
        case 3:
            table[name] = random.choice(np.array([np.nan, 1e308, -1e308, np.inf, -0.0]), len(table))
        case 4:
            table = table.iloc[random.integers(0, len(table), len(table))]
        case _:
            other = str(random.choice(table.columns.to_numpy()))
            table[name] = table[other].to_numpy()
    out = io.BytesIO()
    table.to_parquet(out, index=False)
    return out.getvalue()


_READ = (
    (
        retrieval_files.write_vpr,
        "vpr",
        "logs",
        "logs/east/2026-11-22_19-00-00/database_descriptors.npy",
        spoil_bytes,
    ),
    (
        retrieval_files.write_vpr,
        "vpr log",
        "logs",
        "logs/east/2026-11-22_19-00-00/info.log",
        spoil_text,
    ),
    (
        retrieval_files.write_anyloc,
        "anyloc",
        "anyloc",
        "anyloc/east/photos/q00001.jpg.npy",
        spoil_bytes,
    ),
    (retrieval_files.write_hloc_global, "hloc-global", "", "global-feats-netvlad.h5", spoil_bytes),
    (retrieval_files.write_game4loc, "game4loc", "", "features.npz", spoil_arrays),
    (retrieval_files.write_university1652, "university1652", "", "pytorch_result.mat", spoil_bytes),
    (retrieval_files.write_trec, "trec", "", "mine.run", spoil_text),
)


def of_methods(home: Path) -> list[Input]:
    place = retrieval_files.Place()
    place.prepare(home / "data")
    named = ("--protocol", retrieval_files.PROTOCOL)
    made = []
    for sample, name, given, file, spoil in _READ:
        folder = home / name
        folder.mkdir()
        sample(folder, place)
        reader = ("--reader", name.split()[0])
        path = f"FOLDER/{given}" if given else "FILE"
        commands = (("eval", "retrieval", path, *named, *reader), ("check", path, *named))
        made.append(
            Input(f"readers/{name}", folder, file, spoil, commands, str(home / "data"), 0.5)
        )
    lists = home / "lists"
    for scene in place.scenes:
        retrieval_files.write_lists(lists / "logs" / scene.id, place, scene)
    command = (("eval", "retrieval", "FOLDER/logs", *named),)
    file = "logs/east/preds/001.txt"
    return [
        *made,
        Input("readers/lists", lists, file, spoil_text, command, str(home / "data"), 0.5),
    ]
