"""Results of evaluations, written and read as JSON.

Shares are 0 to 1. An infinite error is the text ``Infinity``, since JSON has no number for it. A
checksum over the content tells a result that was edited by hand.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

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
from airzoo_bench.core.validation import validation_message
from airzoo_bench.results.scores import Score

SHARE_SLACK = 1e-9
"""By how much rounding may lift a share above 1."""

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


class ScoreColumn(ResultModel):
    """How a score is shown and read."""

    key: str
    title: str
    unit: Literal["share", "m", "deg"]
    higher_is_better: bool
    average: Literal["mean", "median"]
    headline: bool


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
    key; `overall` is the unweighted mean over scenes. References are by the name that tables print;
    results of older versions have none. `records_sha256` is of the file of records that was written
    with it, or empty; the checksum is over everything else.
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

    def with_checksum(self) -> Result:
        """Return the same result with its checksum."""
        return self.model_copy(update={"checksum": self._hash_content()})

    def with_records(self, sha256: str) -> Result:
        """Return the same result for records with that hash, with a new checksum."""
        return self.model_copy(update={"records_sha256": sha256}).with_checksum()

    def is_intact(self) -> bool:
        """Whether the checksum fits the content."""
        return self.checksum == self._hash_content()

    def _hash_content(self) -> str:
        content = json.loads(self.model_dump_json(by_alias=True, exclude={"checksum"}))
        if not self.references:  # a field that older results lack
            del content["references"]
        return fingerprint(content)


def score_columns(scores: list[Score]) -> tuple[ScoreColumn, ...]:
    """Turn a track's scores into a result's columns."""
    fields = [asdict(score) for score in scores]
    return tuple(ScoreColumn(key=given.pop("column"), **given) for given in fields)


def write_result(path: Path, result: Result) -> None:
    """Write a result as JSON, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(result.model_dump_json(by_alias=True, indent=1) + "\n")


def read_result(path: Path) -> Result:
    """Read a result and hold it to its checksum."""
    what = "its content was changed after it was written: the checksum does not fit"
    try:
        result = Result.model_validate_json(read_text(path, ResultError, "result file"))
        if result.is_intact():
            return result
    except ValidationError as error:
        what = f"not a result of this version:\n    {validation_message(error, Result)}"
    expected = "a result.json as `airzoo-bench eval ... --out DIR` wrote it"
    raise ResultError(what, where=path, expected=expected, fix="score the predictions again")
