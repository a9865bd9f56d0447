"""Maps, tiles and photos in the report, and what is said where they are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.report.sections import read_sections
from tests.report.made import (
    Page,
    made_page,
    of_benchmark,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    return write_photo_results(tmp_path_factory.mktemp("photos"), ["first", "second"])


def test_a_folder_adds_maps_and_pictures(photos: tuple[Path, list[Path]], tmp_path: Path) -> None:
    data, results = photos
    page = made_page(tmp_path, *results, "--data", data, "--pictures", 3)
    [part] = page.sections
    [found] = part["maps"]
    assert found["picture"].startswith("data:image/jpeg;base64,")
    assert (found["width"], found["height"]) == (256, 256)
    assert found["metresPerPixel"] == pytest.approx(1, rel=1e-2)
    outlines = page.unpack(found["outlines"]).reshape(-1, 4, 2) / found["stepsPerPixel"]
    # A photo sees 100 m x 75 m, and its anchors stand a sixteenth inside.
    sides = outlines.max(axis=1) - outlines.min(axis=1)
    np.testing.assert_allclose(sides, np.tile([87.5, 65.6], (30, 1)), atol=1)
    assert len(part["hardest"]) == 3
    titles = [[picture["title"] for picture in one["pictures"]] for one in part["hardest"]]
    assert titles[0] == ["photo", "the place on the map"]
    assert len(page.unpack(found["ranked"])) == 5 * 2 * 30


def test_retrieved_tiles_are_those_of_the_records_and_hits_those_of_the_truth(
    photos: tuple[Path, list[Path]], tmp_path: Path
) -> None:
    data, results = photos
    page = made_page(tmp_path, *results, "--data", data, "--pictures", 2)
    part = page.sections[0]
    found = part["maps"][0]
    assert found["ranks"] == 5
    tiles, codes = page.unpack(found["tiles"]), page.unpack(found["ranked"]).reshape(5, 2, -1)
    bits = page.unpack(found["hits"]).reshape(2, -1)
    answers = positives(data)
    for row, method in enumerate(read_sections(results)[0].methods):
        for rank in range(5):
            named = method.records[f"tile@{rank + 1}"].tolist()
            assert [tiles[code] for code in codes[rank, row]] == named
            expected = [
                t in answers[q] for q, t in zip(method.records["query"], named, strict=True)
            ]
            assert (bits[row] >> rank & 1).tolist() == expected
        assert (bits[row] & 1).tolist() == method.records["recall@1"].tolist()
    card, records = part["hardest"][0], read_sections(results)[0].methods[0].records
    query = records["query"].iloc[card["row"]]
    assert [tile["rank"] for tile in card["tiles"]] == [1, 2, 3, 4, 5]
    for tile in card["tiles"]:
        assert tile["title"] == records[f"tile@{tile['rank']}"].iloc[card["row"]]
        assert tile["hit"] == (tile["title"] in answers[query])


def positives(data: Path) -> dict[str, set[str]]:
    """Read which tiles answer each query straight from the folder's files."""
    [home] = (data / "park" / "scenes").iterdir()
    tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet")["id"].to_numpy()
    queries = sorted(pd.read_csv(home / "queries.csv")["id"])
    with np.load(home / "retrieval" / "positives.npz") as file:
        ends, indices = file["offsets"][1:-1], file["tiles"]
    return {
        query: set(tiles[part])
        for query, part in zip(queries, np.split(indices, ends), strict=True)
    }


def test_pictures_that_do_not_fit_are_left_out_with_a_note(
    photos: tuple[Path, list[Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, results = photos
    part = made_page(tmp_path, *results, "--data", data, "--pictures", 2).sections[0]
    sizes = [
        sum(len(p["src"]) for p in card["pictures"] + card["tiles"]) for card in part["hardest"]
    ]
    monkeypatch.setattr("airzoo_bench.report.hardest._TOTAL_BYTES", sizes[0] + sizes[1] - 1)
    out = tmp_path / "r.html"
    done = run("report", *results, "--data", data, "--pictures", 2, "-o", out)
    assert "no pictures of 1 of the 2 hardest queries of park-retrieval" in done.stderr
    shown = [bool(card["pictures"]) for card in Page(out).sections[0]["hardest"]]
    assert shown == [True, False]


def test_without_the_folder_there_are_no_maps_and_a_note(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0)])
    done = run("report", *paths, "-o", tmp_path / "r.html")
    assert done.exit_code == 0
    assert "no maps and pictures for made" in done.stderr
    assert Page(tmp_path / "r.html").sections[0]["maps"] == []


def test_a_folder_that_was_named_must_be_the_right_one(
    photos: tuple[Path, list[Path]], tmp_path: Path
) -> None:
    methods = [retrieval_method("a", 0), reconstruction_method("b", 0)]
    # Reconstruction has no maps, and so nothing to look for: its place must not decide.
    other = of_benchmark(methods[1], "another")
    for asked in (methods[:1], [*methods[:1], other], [other, *methods[:1]]):
        paths = write_methods(tmp_path, asked)
        done = run("report", *paths, "--data", photos[0], "-o", tmp_path / "r.html")
        assert isinstance(done.exception, BenchmarkError), [method.name for method in asked]
        assert not (tmp_path / "r.html").exists()


def test_a_photo_that_is_gone_is_left_out(photos: tuple[Path, list[Path]], tmp_path: Path) -> None:
    data, results = photos
    folder = data.parent / "sources" / "photos"
    folder.rename(folder.with_name("moved"))
    try:
        page = made_page(tmp_path, *results, "--data", data, "--pictures", 2)
    finally:
        folder.with_name("moved").rename(folder)
    titles = {p["title"] for one in page.sections[0]["hardest"] for p in one["pictures"]}
    assert titles == {"the place on the map"}
