"""Scores of scenes: of galleries of images by the benchmarks' own definitions, and of chance."""

from __future__ import annotations

import math
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import hypergeom

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.validation import validated
from airzoo_bench.datasets.published.image_pairs import pairs_of_labels
from airzoo_bench.datasets.scenes import ImageScene
from airzoo_bench.datasets.truths import build_stated_truth
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.retrieval.metrics import chance_scores
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.ranking import Ranking, rank_scene
from airzoo_bench.retrieval.settings import RetrievalProtocol, TileScoring
from airzoo_bench.retrieval.track import list_scores, score_scene
from airzoo_bench.retrieval.truth import POSITION_COLUMNS, RetrievalTruth
from tests.retrieval.ranking_support import records_of
from tests.support import MadeScene, protocol
from tests.support import made_truth as made_tiles

QUERIES, IMAGES, CLASSES = 40, 330, 12


def shipped(name: str) -> Any:
    return load_protocol(shipped_protocols()[f"{name}-drone-to-satellite"])


UNIVERSITY = shipped("university-1652")


def made_truth(
    labels: tuple[Any, Any], positions: tuple[Floats, Floats] | None = None, degrees: bool = False
) -> RetrievalTruth:
    sets = []
    for which, (letter, of) in enumerate(zip("qt", labels, strict=True)):
        ids = [f"s/{letter}{number:04d}" for number in range(len(of))]
        table = pd.DataFrame({"id": ids, "image": [f"{one[2:]}.jpg" for one in ids]})
        if positions is not None:
            table[list(POSITION_COLUMNS[not degrees])] = positions[which]
        sets.append(table)
    scene = ImageScene("s", *sets, Path(), Path(), pairs_of_labels(*labels))
    return build_stated_truth(scene, UNIVERSITY.ground_truth)


def score_images(
    truth: RetrievalTruth, settings: Any, content: Any, rows: Any = slice(None)
) -> pd.DataFrame:
    """Score predictions whose rows that are not in `rows` are missing."""
    ids = truth.queries["id"].to_numpy(str)
    predictions = RetrievalPredictions(Path("p.npz"), None, ids, content)
    given = np.full(len(ids), -1)
    given[rows] = np.arange(len(ids))[rows]
    ranked = rank_scene(predictions, truth, given, settings, Run())
    return score_scene(truth, ranked, given >= 0, settings)


class Made:
    """Random descriptors of images of some classes; some classes have many images, some one."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        shares = np.arange(1, CLASSES + 1) / (CLASSES * (CLASSES + 1) / 2)
        draw = random.choice(CLASSES, IMAGES - CLASSES, p=shares)
        self.of_images = np.concatenate([np.arange(CLASSES), draw])
        self.of_queries = random.integers(0, CLASSES, QUERIES)
        self.labels = self.of_queries.astype(str), self.of_images.astype(str)
        means = random.standard_normal((CLASSES, 16))
        self.images, self.queries = (
            (means[of] + 1.5 * random.standard_normal((len(of), 16))).astype(np.float32)
            for of in (self.of_images, self.of_queries)
        )
        # Rows of the images for each query, the greatest inner product first.
        products = self.queries.astype(np.float64) @ self.images.astype(np.float64).T
        self.orders = np.argsort(-products, axis=1)

    def score(self, truth: RetrievalTruth, settings: Any, rows: Any = slice(None)) -> pd.DataFrame:
        content = Descriptors(self.queries, truth.tiles["id"].to_numpy(str), self.images)
        return score_images(truth, settings, content, rows)


def curve_area(right: np.ndarray[Any, Any]) -> float:
    """Area below precision over recall, both walked rank by rank, a trapezoid at every hit."""
    area, hits, total = 0.0, 0, int(right.sum())
    for rank, is_right in enumerate(right.tolist(), start=1):
        precision_so_far = hits / (rank - 1) if rank > 1 else 1.0
        if is_right:
            hits += 1
            area += (precision_so_far + hits / rank) / 2 / total
    return area


@pytest.mark.parametrize("seed", range(2))
def test_university_1652_scores(seed: int) -> None:
    made, settings = Made(seed), UNIVERSITY.scores
    records = made.score(made_truth(made.labels), settings)
    hits = made.of_images[made.orders] == made.of_queries[:, None]
    # Their code looks at place round(330 * 0.01) = 3 of a curve that counts from 0.
    for column, place in (("recall@1", 0), ("recall@5", 4), ("recall@10", 9), ("recall@1%", 3)):
        expected = hits[:, : place + 1].any(axis=1).mean()
        assert records[column].mean() == pytest.approx(expected, abs=1e-12), column
    areas = [curve_area(hit) for hit in hits]
    np.testing.assert_allclose(records["ap/trapezoid"], areas, atol=1e-12)
    precision = [np.mean((np.cumsum(h) / np.arange(1, IMAGES + 1))[h]) for h in hits]
    np.testing.assert_allclose(records["map"], precision, atol=1e-12)
    headline = [score.title for score in list_scores(settings) if score.headline]
    assert headline == ["R@1", "R@5", "R@10", "R@1%", "AP"]


def haversine(one: Floats, other: Floats) -> float:
    (lon_a, lat_a), (lon_b, lat_b) = np.radians(one), np.radians(other)
    half = math.sin((lat_a - lat_b) / 2) ** 2
    half += math.cos(lat_a) * math.cos(lat_b) * math.sin((lon_a - lon_b) / 2) ** 2
    return 2 * math.asin(math.sqrt(half)) * 6_378_137


def sdm(apart: Floats, k: int, scale: float) -> Floats:
    weight = np.arange(k, 0, -1)
    return np.asarray((weight / np.exp(scale * apart[:, :k])).sum(axis=1) / weight.sum())


def test_denseuav_scores() -> None:
    made, settings = Made(0), shipped("denseuav").scores
    # DenseUAV's place: metres are some 1e-5 degrees, and float32 has 7.6e-6 at 120.
    places = np.array([120.385, 30.318]) + np.random.default_rng(0).uniform(0, 0.004, (CLASSES, 2))
    asked, given = places[made.of_queries], places[made.of_images]
    truth = made_truth(made.labels, (asked, given), degrees=True)
    records = made.score(truth, settings)
    steps = given.astype(np.float32)[made.orders] - asked.astype(np.float32)[:, None]
    apart = np.sqrt((steps.astype(np.float64) ** 2).sum(axis=2))
    for k in (1, 3, 5, 10):
        np.testing.assert_allclose(records[f"sdm@{k}"], sdm(apart, k, 5000), atol=1e-9)
    firsts = [haversine(a, given[order[0]]) for a, order in zip(asked, made.orders, strict=True)]
    np.testing.assert_allclose(records["dis@1"], firsts, rtol=1e-6, atol=1e-6)
    for limit in (5, 10, 20, 50):
        assert records[f"ma@{limit}m"].mean() == np.mean(np.array(firsts) < limit)
    assert 0 < records["sdm@10"].mean() < 1
    # Of every second query the predictions lack, nothing is found, the farthest image is taken.
    half = made.score(truth, settings, slice(None, None, 2))
    nothing = half.iloc[1::2][["recall@10", "recall@1%", "map", "sdm@10", "ma@50m"]]
    assert not nothing.to_numpy().any()
    farthest = [max(haversine(one, place) for place in given) for one in asked[1::2]]
    np.testing.assert_allclose(half["dis@1"].iloc[1::2], farthest, rtol=1e-9)
    pd.testing.assert_frame_equal(half.iloc[::2], records.iloc[::2])


def test_gta_uav_scores() -> None:
    made, settings = Made(1), shipped("gta-uav-cross-area").scores
    random = np.random.default_rng(1)
    places = random.uniform(0, 9000, (QUERIES, 2)), random.uniform(0, 9000, (IMAGES, 2))
    records = made.score(made_truth(made.labels, places), settings)
    metres = np.linalg.norm(places[1][made.orders] - places[0][:, None], axis=2)
    for k in (1, 3, 5):
        np.testing.assert_allclose(records[f"sdm@{k}"], sdm(metres, k, 0.001), rtol=1e-12)
        np.testing.assert_allclose(records[f"dis@{k}"], metres[:, :k].mean(axis=1), rtol=1e-12)
    scores = {score.title: score for score in list_scores(settings) if score.headline}
    near = [f"{name}@{k}" for name in ("SDM", "Dis") for k in (1, 3, 5)]
    assert [*scores] == ["R@1", "R@5", "R@10", "R@1%", "AP", *near]
    assert scores["AP"].key == "map"  # scikit-learn's, not the trapezoids'


def test_a_distance_at_its_limit_is_no_hit() -> None:
    places = np.zeros((1, 2)), np.array([[3.0, 4.0]])
    settings = shipped("gta-uav-cross-area").scores
    near = settings.distances.model_copy(update={"ma_below_m": (5.0, 6.0)})
    settings, ranked = settings.model_copy(update={"distances": near}), [["s/t0000"]]
    truth = made_truth((["1"], ["1"]), places)
    records = score_images(truth, settings, RankedIds(np.array(ranked), None))
    assert records[["ma@5m", "ma@6m"]].to_numpy().tolist() == [[0, 1]]
    order = np.array([[1, 0]], np.int32)
    limit = score_orders(order, 1, tile_scores())["distance_m"].item()
    found = score_orders(order, 1, tile_scores(distance_below_m=(limit, 2 * limit)))
    assert [found[f"distance<{m:g}m"].item() for m in (limit, 2 * limit)] == [0, 1]


def test_positives_that_are_not_ranked_are_never_found() -> None:
    truth = made_truth((["1", "2"], ["1", "1", "2", "3"]))
    ranked = RankedIds(np.array([["s/t0003", "s/t0001"], ["", ""]]), None)
    records = score_images(truth, UNIVERSITY.scores, ranked)
    # One of two positives, at rank 2: half of (0 / 1 + 1 / 2) / 2.
    assert records["ap/trapezoid"].tolist() == [1 / 8, 0.0]
    assert records["map"].tolist() == [1 / 4, 0.0]
    assert records["recall@5"].tolist() == [1.0, 0.0]
    assert records["recall@1%"].tolist() == [0.0, 0.0]


GTA = "gta-uav-same-area-drone-to-satellite"
OF_GTA = load_protocol(shipped_protocols()[GTA]).model_dump(by_alias=True)
NEAR = OF_GTA["scores"]["distances"]


@pytest.mark.parametrize(
    ("base", "section", "changes", "named"),
    [
        (UNIVERSITY.name, "scores", {"distances": NEAR}, "scores.distances"),
        (GTA, "scores", {"distances": None}, "scores.distances"),
        (GTA, "gallery", {"positions": "degrees"}, "positions"),
        (GTA, "scores", {"distances": NEAR | {"sdm_unit": "degree"}}, "sdm_unit"),
        (GTA, "scores", {"ranks_kept": 4}, "ranks_kept"),
        ("uav-visloc-retrieval", "ground_truth", OF_GTA["ground_truth"], "ground_truth"),
    ],
)
def test_sections_must_fit(base: str, section: str, changes: dict[str, Any], named: str) -> None:
    values = load_protocol(shipped_protocols()[base]).model_dump(by_alias=True)
    values[section] = {k: v for k, v in (values[section] | changes).items() if v is not None}
    with pytest.raises(ProtocolError, match=named):
        validated(values, RetrievalProtocol, ProtocolError, None, "protocol file")


# --- chance, against all orders there are, SciPy, and the metrics themselves ---


def tile_scores(**changes: object) -> TileScoring:
    return TileScoring.model_validate(protocol().scores.model_dump() | changes)


def score_orders(tiles: np.ndarray, n_positives: int, chosen: TileScoring) -> dict[str, np.ndarray]:
    """Score orders (n, tiles) of a gallery whose first tiles are positive by our own metrics."""
    scene = MadeScene("s", [list(range(n_positives))] * len(tiles), tiles.shape[1])
    ranking = Ranking(tiles[:, : chosen.ranks_kept], np.zeros(len(tiles), bool))
    return dict(records_of(made_tiles(scene), ranking, chosen).select_dtypes("number"))


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 12), st.data())  # of which 10 at least are kept
def test_chance_is_the_mean_over_all_orders(n_tiles: int, data: st.DataObject) -> None:
    n_positives = data.draw(st.integers(0, n_tiles))
    ranks = {"ranks_kept": data.draw(st.integers(10, 12)), "ap_at": data.draw(st.integers(1, 7))}
    chosen = tile_scores(**ranks)
    places = list(combinations(range(n_tiles), n_positives))  # only these can matter
    tiles = np.empty((len(places), n_tiles), np.int32)
    for row, place in zip(tiles, places, strict=True):
        row[list(place)] = np.arange(n_positives)
        row[np.setdiff1d(np.arange(n_tiles), place)] = np.arange(n_positives, n_tiles)
    expected = score_orders(tiles, n_positives, chosen)
    assert not expected["cut_short"].any()  # nothing is asked for beyond what is kept
    found = chance_scores(np.array([n_positives]), n_tiles, chosen)
    names = {"map", "mrr", *(name for name in expected if name.startswith(("re", "ap@", "nd")))}
    assert set(found) == names
    for name, value in found.items():
        assert value[0] == pytest.approx(expected[name].mean(), abs=1e-12), name


def test_chance_of_recall_is_that_of_scipy_for_each_query() -> None:
    positives = np.array([1, 3, 40, 500, 0, 3, 5000])
    found = chance_scores(positives, 5000, tile_scores())
    for k in (1, 3, 5):
        expected = hypergeom.sf(0, 5000, positives, k)
        np.testing.assert_allclose(found[f"recall@{k}"], expected, rtol=1e-9)


@pytest.mark.parametrize(("n_tiles", "n_positives"), [(5, 1), (5, 2), (5, 5), (2, 2)])
def test_chance_of_images_is_the_mean_over_all_orders(n_tiles: int, n_positives: int) -> None:
    settings = UNIVERSITY.scores.model_copy(update={"ranks_kept": 3})  # whole lists are scored
    orders = list(permutations(range(n_tiles)))
    labels = ["1"] * n_positives + ["2"] * (n_tiles - n_positives)
    truth = made_truth((["1"] * len(orders), labels))
    ids = truth.tiles["id"].to_numpy(str)
    ranked = RankedIds(np.array([ids[list(order)] for order in orders]), None)
    records = score_images(truth, settings, ranked)
    found = chance_scores(np.array([n_positives, 0]), n_tiles, settings)
    assert {"recall@1", "recall@1%", "ap/trapezoid", "map", "mrr"} <= set(found)
    for name, value in found.items():
        assert value == pytest.approx([records[name].mean(), 0], abs=1e-12), name
