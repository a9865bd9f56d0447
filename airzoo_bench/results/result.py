"""Results of evaluations: scores averaged from records, and the JSON that holds them.

Shares are 0 to 1. An infinite error is the text ``Infinity``, since JSON has no number for it. A
checksum over the content tells a result that was edited by hand.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import atomic_write, fingerprint, read_text
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import nearest, validation_message
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.storage.urls import fetch, url_of

if TYPE_CHECKING:
    import pandas as pd  # tables of results do without

SHARE_SLACK = 1e-9  # by how much rounding may lift a share above 1

_FILE = "result.json"

Scores = dict[str, Annotated[float, Field(ge=0)]]  # which NaN is not
# The largest is that which JavaScript still counts with.
Count = Annotated[int, Field(ge=0, le=(1 << 53) - 1)]


def _make_printable(name: object) -> object:
    """Replace what does not print: names of files may hold bytes that are no text."""
    if not isinstance(name, str):
        return name
    return "".join(c if c.isprintable() else "\ufffd" for c in name)


Name = Annotated[str, BeforeValidator(_make_printable)]


class ResultModel(BaseModel):
    """Settings of all parts of a result."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, ser_json_inf_nan="strings", allow_inf_nan=True
    )


class ScoreColumn(ResultModel):
    """A score: a column of the records, by `key`, and the way it is averaged, shown and read.

    Tables show headlines without being asked. Shares are percent there.
    """

    key: str
    title: str
    unit: Literal["share", "m", "deg"]
    higher_is_better: bool
    average: Literal["mean", "median"]
    headline: bool

    @classmethod
    def share(cls, key: str, title: str, *, headline: bool = False) -> ScoreColumn:
        """Return a mean of shares, where higher is better."""
        kind: Any = {"unit": "share", "higher_is_better": True, "average": "mean"}
        return cls(key=key, title=title, headline=headline, **kind)

    @classmethod
    def error(
        cls, key: str, title: str, unit: str, average: str, *, headline: bool = False
    ) -> ScoreColumn:
        """Return an average of errors, where lower is better."""
        kind: Any = {"unit": unit, "higher_is_better": False, "average": average}
        return cls(key=key, title=title, headline=headline, **kind)


class ProtocolUsed(ResultModel):
    """The protocol that a result was made with."""

    name: str
    version: int
    fingerprint: str
    settings: dict[str, Any]


class TruthUsed(ResultModel):
    """The truth that predictions were compared with."""

    benchmark: str
    version: int
    fingerprint: str
    scene_titles: dict[str, str]


class ReaderUsed(ResultModel):
    """The reader of a method's own files, and the conventions that it assumed."""

    name: Name
    conventions: tuple[Name, ...]


class PredictionsUsed(ResultModel):
    """The predictions; files of the suite's own layout have no reader, and results no such key."""

    file: Name
    sha256: str
    kind: str
    method: Name
    reader: ReaderUsed | None = None

    @model_serializer(mode="wrap")
    def _without_reader(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = write(self)
        return fields if self.reader else {k: v for k, v in fields.items() if k != "reader"}


class Reference(ResultModel):
    """Scores without a method, such as chance; `meaning` is a sentence that tables print below.

    Scores are as in `Result`; those that make no sense are left out, of all three parts alike.
    """

    meaning: str
    scenes: dict[str, Scores]
    overall: Scores
    pooled: Scores


class Result(ResultModel):
    """All that is known of one evaluation.

    Each scene has counts of queries, missing ones, and what else the track counts. Scores are by
    key; `overall` is the unweighted mean over scenes. References are by the name that tables print.
    `records_sha256` is of the records that were written with it; the checksum is over all else.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    track: str
    protocol: ProtocolUsed
    truth: TruthUsed
    predictions: PredictionsUsed
    versions: dict[str, str]
    columns: tuple[ScoreColumn, ...]
    counts: dict[str, dict[str, Count]]
    extra_queries: Count
    notes: tuple[str, ...]
    scenes: dict[str, Scores]
    overall: Scores
    pooled: Scores
    references: dict[Name, Reference] = Field(default_factory=dict)
    records_sha256: str = ""
    checksum: str = ""

    @model_validator(mode="after")
    def _parts_fit(self) -> Result:
        shares = {column.key: column.unit == "share" for column in self.columns}
        every: list[Result | Reference] = [self, *self.references.values()]
        by_scene: list[dict[str, Any]] = [self.counts, self.truth.scene_titles]
        by_scene += [one.scenes for one in every]
        if not self.scenes or any(set(part) != set(self.scenes) for part in by_scene):
            raise ValueError("counts, titles and scores are not of the same scenes")
        for one in every:
            keys = set(shares) if one is self else set(one.overall) & set(shares)
            for part in (*one.scenes.values(), one.overall, one.pooled):
                if not part or set(part) != keys:
                    raise ValueError("scores do not fit the columns")
                if any(value > 1 + SHARE_SLACK for key, value in part.items() if shares[key]):
                    raise ValueError("a share is above 1")
        if not all("queries" in counts for counts in self.counts.values()):
            raise ValueError("a scene has no count of queries")
        if "airzoo-bench" not in self.versions:
            raise ValueError("the version of airzoo-bench is not given")
        return self

    @property
    def unit(self) -> Literal["query", "scene"]:
        """The unit of a record, by the track; a query where the track is not installed."""
        return TRACKS.get(self.track).unit if self.track in TRACKS else "query"

    def with_checksum(self, **changes: Any) -> Result:
        """Return the result with changes and the checksum of its content."""
        changed = self.model_copy(update=changes)
        content = json.loads(changed.model_dump_json(by_alias=True, exclude={"checksum"}))
        if not changed.references:  # a field that older results lack
            del content["references"]
        return changed.model_copy(update={"checksum": fingerprint(content)})


def write_result(path: Path, result: Result) -> None:
    """Write a result as JSON, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(result.model_dump_json(by_alias=True, indent=1) + "\n")


def read_result(path: Path) -> Result:
    """Read a result and hold it to its checksum."""
    what = "its content was changed after it was written: the checksum does not fit"
    try:
        result = Result.model_validate_json(read_text(path, ResultError, "result file"))
        if result.checksum == result.with_checksum().checksum:
            return result
    except ValidationError as error:
        what = f"not a result of this version:\n    {validation_message(error, Result)}"
    expected = "a result.json as `airzoo-bench eval ... --out DIR` wrote it"
    raise ResultError(what, where=path, expected=expected, fix="score the predictions again")


# --- files that people name ---


def result_paths(given: Sequence[str | Path], others: Iterable[str] = ()) -> tuple[Path, ...]:
    """Return the files of results, of folders and URLs; a typo may be meant for one of `others`."""
    paths = []
    for location in given:
        url, path = url_of(location), Path(location)
        if url is not None:
            is_file = url.partition("?")[0].endswith(".json")
            path = fetch(url if is_file else f"{url.rstrip('/')}/{_FILE}")
        elif path.is_dir():
            path = path / _FILE
            if not path.is_file():
                fix = f"name the folder that holds it, perhaps {location}/*"
                raise ResultError(f"a folder without a {_FILE}", where=location, fix=fix)
        elif not path.exists():
            near = nearest(path.name, [*others, *(one.name for one in path.parent.glob("*"))])
            fix = "`airzoo-bench demo` makes airzoo-demo in this folder, `eval --out DIR` others"
            raise ResultError(f"no such result file{near}", where=location, fix=fix)
        elif path.suffix in (".npz", ".parquet"):
            fix = f"score it first: airzoo-bench eval TRACK {location} --out DIR"
            raise ResultError("a prediction file, not a result", where=location, fix=fix)
        paths.append(path)
    return tuple(dict.fromkeys(paths))


def method_names(paths: Sequence[Path], results: Sequence[Result]) -> list[str]:
    """Return the methods' names, with parts of paths where several are alike."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for number, one in enumerate(results):
        key = one.protocol.fingerprint, one.truth.fingerprint, one.predictions.method
        alike.setdefault(key, []).append(number)
    names = [result.predictions.method for result in results]
    for numbers in (some for some in alike.values() if len(some) > 1):
        short = [paths[number].parent.name for number in numbers]
        if len(set(short)) < len(numbers):
            short = [str(paths[number]) for number in numbers]
        for number, where in zip(numbers, short, strict=True):
            names[number] += f" ({where})"
    return names


# --- averages of records ---


@dataclass(frozen=True)
class Summary:
    """Scores by key: of each scene, their unweighted mean (of medians too), and of all rows."""

    scenes: dict[str, dict[str, float]]
    overall: dict[str, float]
    pooled: dict[str, float]


def summarise(
    records: pd.DataFrame, scores: Sequence[ScoreColumn], scenes: Sequence[Any]
) -> Summary:
    """Average records."""
    of_row, keys = records["scene"].to_numpy(), [score.key for score in scores]
    per_scene = {scene: _average(records, np.asarray(of_row == scene), scores) for scene in scenes}
    overall = {key: float(np.mean([part[key] for part in per_scene.values()])) for key in keys}
    return Summary(per_scene, overall, _average(records, slice(None), scores))


def _average(
    records: pd.DataFrame, rows: Bools | slice, scores: Sequence[ScoreColumn]
) -> dict[str, float]:
    found = {}
    for score in scores:
        values = records[score.key].to_numpy(np.float64)[rows]
        if values.size == 0 or np.isnan(values).any():
            raise ValueError(f"{score.key}: no record, or NaN, in {values.size} rows")
        average = np.median if score.average == "median" else np.mean
        found[score.key] = float(average(values))
    return found
