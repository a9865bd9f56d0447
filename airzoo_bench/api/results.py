"""Results from Python: predictions scored and checked, results read, drawn, compared; intervals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.arguments import Scores
from airzoo_bench.benchmark.folder import data_here
from airzoo_bench.core.files import write_npz
from airzoo_bench.evaluation import evaluate as scoring
from airzoo_bench.evaluation.predictions import ReadRequest
from airzoo_bench.evaluation.track import Run
from airzoo_bench.results import comparison
from airzoo_bench.results.comparison import check_same_queries, choose_scores, find_scene
from airzoo_bench.results.records import Method, check_records, read_methods, write_csv
from airzoo_bench.results.result import write_result
from airzoo_bench.statistics.intervals import Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.storage.urls import local_path
from airzoo_bench.tables.comparison import comparison_table, intervals_table, verdict
from airzoo_bench.tables.layouts import scenes_table
from airzoo_bench.tables.model import Table
from airzoo_bench.tables.render import render

Predictions = str | Path | Mapping[str, Any]
Statistic = Literal["share", "mean", "median"]

_COMPARED = """score method reference value reference_value difference low high p p_holm p_mcnemar
wins ties losses verdict"""


@dataclass(frozen=True, eq=False, repr=False)
class Result(Method):
    """A method's result with its records; it shows itself as the table that ``eval`` prints.

    `name` is the method's; `result` is the content of result.json: protocol, truth, predictions,
    counts, notes, scores; `records` is a DataFrame with a row a query, or a scene in
    reconstruction, sorted by ``query``.
    """

    @property
    def overall(self) -> dict[str, float]:
        """Every score's unweighted mean over scenes; shares are 0 to 1."""
        return dict(self.result.overall)

    def to_frame(self) -> pd.DataFrame:
        """Return scenes x scores, by id and key, with the rows ``overall`` and ``pooled`` last."""
        result = self.result
        rows = {**result.scenes, "overall": result.overall, "pooled": result.pooled}
        frame = pd.DataFrame.from_dict(rows, orient="index")
        return frame[[column.key for column in result.columns]].rename_axis("scene")

    def table(self, form: str = "terminal") -> str:
        """Return the table of scenes as ``airzoo-bench table --format FORM`` writes it."""
        return render(scenes_table(self.result, floors=True), form, width=120)

    def plot(self, kind: str, *others: Method, score: str | None = None, **options: Any) -> Any:
        """Draw this result, and others of its protocol and truth, as ``airzoo-bench plot`` does.

        `kind` is recall, errors, thresholds or condition, `score` a key or title, by default the
        first that fits; `options` are ``by`` and ``bins`` of condition, ``up_to`` of recall.
        """
        from airzoo_bench.report import draw  # Matplotlib takes a second to load

        arg.choice("kind", kind, draw.KINDS)
        return draw.draw_methods(kind, [self, *others], score, **options)

    def save(self, folder: str | Path) -> Path:
        """Write ``result.json`` and ``records.csv`` into a folder; return the first one's path."""
        path = Path(folder, "result.json")
        path.parent.mkdir(parents=True, exist_ok=True)
        checksum = write_csv(self.records, path.with_name("records.csv"))
        write_result(path, self.result.with_checksum(records_sha256=checksum))
        return path

    def report(self, path: str | Path, data: str | Path | None = None) -> Path:
        """Write the report of this result as ``airzoo-bench report`` does; return its path.

        Maps and pictures are added where the benchmark folder is there (`data` as in `evaluate`).
        """
        from airzoo_bench.report.page import make_report  # Matplotlib takes a second to load

        with TemporaryDirectory() as folder:
            page, _ = make_report([self.save(folder)], data=data_here(data))
        Path(path).write_text(page, encoding="utf-8")
        return Path(path)

    def __repr__(self) -> str:
        return self.table().rstrip("\n")

    def _repr_html_(self) -> str:
        return self.table("html")


def load_result(path: str | Path, *, name: str | None = None) -> Result:
    """Read a result that ``airzoo-bench eval ... --out DIR`` wrote, and its records.

    `path` is that of ``result.json`` or its folder, or a URL; `name` is a name of the method
    instead of its own. Raises a `UserError` where it is missing, was changed since it was written,
    or its records do not fit it.
    """
    (found,) = read_methods([path])
    return Result(name or found.name, found.result, found.records)


def evaluate(
    predictions: Predictions,
    *,
    protocol: str | None = None,
    data: str | Path | None = None,
    method: str | None = None,
    reader: str | None = None,
    names: str | Path | None = None,
    jobs: int = 2,
    max_memory: int = 2 << 30,
) -> Result:
    """Score predictions on a benchmark folder, as ``airzoo-bench eval`` does.

    Raises a `UserError` where predictions, protocol or benchmark folder are not as they must be.

    Parameters
    ----------
    predictions : path or mapping of str to array-like
        A prediction file, folder or archive; or the fields of one (the docs page of its track).
    protocol, data : str, path, optional
        Name or path of a protocol, by default the predictions' own; the benchmark folder, or the
        one that holds it, by default ``AIRZOO_BENCH_DATA`` or a cache.
    method, reader : str, optional
        Names: in tables, by default the file's; the reader's, by default found from the content.
    names : path, optional
        A list of images, a line each, in the order in which the method saw them.
    jobs, max_memory : int
        Threads, and bytes for the predictions; the numbers do not depend on them.
    """
    request = ReadRequest(reader, None if names is None else Path(names))
    run = Run(memory_bytes=max_memory, jobs=jobs)
    with _as_path(predictions) as path:
        named: Any = {"protocol": protocol, "method": method, "data": data_here(data)}
        done = scoring.evaluate(path, run=run, request=request, **named)
    result, records = done.result, done.records
    if "query" not in records:
        records = records.assign(query=records["scene"])
    name = result.predictions.method
    return Result(name, result, check_records(records, result, name))


def check(
    predictions: Predictions,
    *,
    protocol: str | None = None,
    data: str | Path | None = None,
    reader: str | None = None,
    names: str | Path | None = None,
) -> scoring.Check:
    """Find errors of predictions, the first in each file or scene, without scoring them.

    Parameters are as in `evaluate`; the truth of the benchmark may be sealed. Raises a `UserError`
    where there is nothing to check: no such file, or no known protocol.
    """
    request = ReadRequest(reader, None if names is None else Path(names))
    with _as_path(predictions) as path:
        return scoring.check(path, data=data_here(data), protocol=protocol, request=request)


@contextmanager
def _as_path(predictions: Predictions) -> Iterator[Path]:
    """Yield the path of predictions; arrays are written to a file first, as a user would."""
    if not isinstance(predictions, Mapping):
        yield local_path(predictions)
        return
    fields = {name: arg.as_array(name, values) for name, values in predictions.items()}
    # Columns of pandas hold text as objects.
    fields = {name: one.astype(str) if one.dtype == object else one for name, one in fields.items()}
    with TemporaryDirectory() as folder:
        path = Path(folder, "predictions.npz")
        write_npz(path, fields)
        yield path


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """A comparison; `table` is shown, `frame` is a DataFrame of the numbers, see `compare`."""

    table: Table
    frame: pd.DataFrame

    def __repr__(self) -> str:
        return render(self.table, "terminal", width=120).rstrip("\n")

    def _repr_html_(self) -> str:
        return render(self.table, "html")


def compare(
    results: str | Path | Method | Iterable[str | Path | Method],
    scores: Sequence[str] = (),
    *,
    every: bool = False,
    reference: str | None = None,
    scene: str | None = None,
) -> Comparison:
    """Compare results query by query: differences, intervals, tests, a verdict in words.

    Its `frame` has a row a score and method, with the difference to the reference, its interval and
    tests; of a single result a row a scene (None for the average) and score. docs/statistics.md
    explains them. Raises a `UserError` for results, scores, methods or scenes that do not fit.

    Parameters
    ----------
    results : path, Result, or several of them
        Of one protocol and one truth. A single result gives its intervals.
    scores, every : sequence of str, bool
        Keys or titles, by default the headline ones; or every score instead.
    reference, scene : str, optional
        The method to compare with, by default the first, or "best"; one scene by id or title.
    """
    kinds, plan = str | Path | Method, ResamplingConfig()
    listed = [results] if isinstance(results, kinds) else arg.listed("results", results)
    if not listed or not all(isinstance(one, kinds) for one in listed):
        raise arg.fault("results", "holds no results", "results, or paths of result.json")
    read = iter(read_methods([one for one in listed if not isinstance(one, Method)]))
    each = (one if isinstance(one, Method) else next(read, None) for one in listed)
    methods = [one for one in each if one is not None]  # a path named twice is read once
    if len({one.name for one in methods}) < len(methods):
        fix = "load_result(path, name=...)"
        raise arg.fault("results", "several have one name", "methods of different names", fix)
    check_same_queries(methods)
    chosen = choose_scores(methods, arg.listed("scores", scores), every=every)
    if len(methods) == 1:
        if scene is not None:
            scene = find_scene(methods[0].result.truth.scene_titles, scene)
        found = comparison.score_intervals(methods[0], chosen, plan, scene)
        rows = [
            {"scene": name, "score": score.key, **vars(one)}
            for name, part in [*found.groups.items(), (None, found.overall)]
            for score, one in zip(chosen, part, strict=True)
        ]
        return Comparison(intervals_table(methods[0], chosen, plan), pd.DataFrame(rows))
    made = comparison.compare(methods, chosen, reference=reference, scene=scene, resampling=plan)
    rows = [
        {**vars(pair.interval), **vars(pair), "score": pair.score.key, "p": pair.test.p_value}
        | {"verdict": verdict(pair)}
        for pair in made.pairs
    ]
    return Comparison(comparison_table(made), pd.DataFrame(rows)[_COMPARED.split()])


def bootstrap_ci(
    values: ArrayLike,
    scenes: ArrayLike | None = None,
    *,
    statistic: Statistic,
    confidence: float = 0.95,
    seed: int = 0,
) -> Scores:
    """Return the confidence interval of an average; docs/statistics.md says how it is made.

    Returns ``estimate``; its ``low`` and ``high``, which may be infinite, or None, with a
    ``reason``, where a scene has fewer than 5 queries or all resampled values are alike;
    ``method``: "wilson", "mover", "bca" or "percentile"; ``scenes``, the same of each scene by
    name. Raises an `ArgumentError` for NaN, no value, shares outside 0 to 1, `scenes` of another
    length, settings out of range.

    Source: Wilson, JASA 22, 1927. Zou and Donner, Statistics in Medicine 27, 2008 (MOVER). Efron
    and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 14 (BCa).

    Parameters
    ----------
    values : (N,) array-like
        A value a query. Infinite errors are values like all others.
    scenes : (N,) array-like, optional
        The scene of each: the average is the unweighted mean of theirs, resampled within scenes.
    statistic : {"share", "mean", "median"}
        Means of shares from 0 to 1, such as hits and AP, have Wilson's interval, over scenes
        MOVER's; other means and medians are bootstrapped.
    confidence, seed : float, int
        Between 0 and 1; the seed of the 10,000 resamples.
    """
    arg.choice("statistic", statistic, get_args(Statistic))
    share = arg.positive("confidence", confidence, 0.999999)  # beyond it rounding decides
    plan = ResamplingConfig(seed=arg.whole("seed", seed, 0), confidence=share)
    numbers = arg.floats("values", values, (None,))
    if len(numbers) == 0:
        raise arg.fault("values", "holds no value", "a number a query")
    bad = ~((numbers >= 0.0) & (numbers <= 1.0)) if statistic == "share" else ~(numbers > -np.inf)
    expected = "numbers, infinite for failures; shares from 0 to 1, not percent"
    arg.refuse_rows("values", bad, "NaN or a value out of range", expected)
    groups = {"": numbers}
    if scenes is not None:
        arg.check_pairs(values=values, scenes=scenes)
        rows, names = pd.factorize(arg.as_array("scenes", scenes).astype(object))
        arg.refuse_rows("scenes", rows < 0, "no name", "the scene of each value")
        groups = {str(name): numbers[rows == place] for place, name in enumerate(names)}
    kinds = (np.array([statistic == kind]) for kind in ("median", "share"))
    sample = Sample("query", tuple(groups), tuple(one[None] for one in groups.values()), *kinds)
    found = sample_intervals(sample, plan, groups=scenes is not None)
    average = np.median if statistic == "median" else np.mean
    means = {name: float(average(part)) for name, part in groups.items()}
    parts = {name: _as_scores(means[name], one) for name, (one, *_) in found.groups.items()}
    return _as_scores(float(np.mean(list(means.values()))), found.overall[0], scenes=parts)


def _as_scores(estimate: float, found: Interval, **more: Any) -> Scores:
    known = {name: value for name, value in vars(found).items() if value not in (None, "")}
    return Scores({"estimate": estimate} | known, **vars(found) | more)
