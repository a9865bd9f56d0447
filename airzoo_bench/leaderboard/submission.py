"""What a submission states of itself, in ``submission.toml``."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import tomli_w
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Name, Positive, Strict, read_toml, validated
from airzoo_bench.leaderboard.fields import Bibtex, Contact, Licence, Sha256, Url
from airzoo_bench.leaderboard.names import BoardName, Line, plain_line

__all__ = [
    "CLAIMED_FILE",
    "SCHEMA_LINE",
    "SUBMISSION_FILE",
    "Cost",
    "Pipeline",
    "PredictionsGiven",
    "PublicSubmission",
    "Submission",
    "read_public_submission",
    "read_submission",
    "submission_text",
]

SUBMISSION_FILE = "submission.toml"
SCHEMA_LINE = "#:schema ../../../../docs/submission.schema.json"
"""What tells editors the schema, from the folder of a submission; see `schema`."""
CLAIMED_FILE = "result.json"
"""What the submitter's own `eval` gave, next to submission.toml; it need not be there."""

_LIMIT_BYTES = (
    16 << 10
)  # a key of so many dots takes tomllib a second, and four times that of twice


Setting = bool | int | float
P = TypeVar("P", bound="PublicSubmission")


class PredictionsGiven(Strict):
    """Where the predictions lie: next to submission.toml, or at an address."""

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": ["file"]}, {"required": ["url"]}]}
    )

    file: Name | None = Field(
        None,
        description="The file or folder next to submission.toml; or say url instead.",
        examples=["predictions.npz"],
    )
    url: Url | None = Field(
        None,
        description="Where CI fetches the predictions, a file or an archive, over https.",
        examples=["https://zenodo.org/records/1/files/predictions.npz"],
    )
    sha256: Sha256 = Field(
        description="SHA-256 of the file; of a folder, over its files' names and hashes, as "
        "`airzoo-bench submission new` writes it.",
        examples=["0" * 64],
    )
    size: Annotated[int, Field(ge=1, le=1 << 50)] = Field(
        alias="bytes", description="Size in bytes; of a folder, of all its files.", examples=[52431]
    )
    reader: Name | None = Field(
        None,
        description="What reads the files where they are as the method wrote them; "
        "`airzoo-bench readers` lists what there is.",
        examples=["hloc-poses"],
    )
    names: Name | None = Field(
        None,
        description="A list of image names next to submission.toml, a line each, where the "
        "method's files do not name them.",
        examples=["names.txt"],
    )

    @model_validator(mode="after")
    def _one_place(self) -> PredictionsGiven:
        if (self.file is None) == (self.url is None):
            raise ValueError('either file or url, such as file = "predictions.npz"')
        if {self.file, self.names} & {SUBMISSION_FILE, CLAIMED_FILE} or (
            self.names is not None and self.file == self.names
        ):
            raise ValueError("file and names are other files than submission.toml and result.json")
        return self


class Pipeline(Strict):
    """What the method is: entries of different classes are not compared like with like."""

    stages: Literal["single-stage", "re-ranked"] = Field(
        description="Whether a first answer is re-ordered or refined by a second method.",
        examples=["single-stage"],
    )
    uses: tuple[Literal["prior", "sequence", "heights"], ...] = Field(
        (),
        description="What is used beside the photo and the map: the photo's own position and "
        "attitude (prior), other photos of the flight (sequence), the surface model (heights).",
        examples=[["prior"]],
    )


class Cost(Strict):
    """What an answer costs, as the authors say."""

    hardware: Line = Field(
        description="The machine that was timed.", examples=["1 x RTX 4090, 24 GB"]
    )
    seconds_per_query: Positive = Field(
        description="Time for one query, in reconstruction for one scene, with all stages, once "
        "maps are prepared.",
        examples=[0.042],
    )
    memory_gb: Positive | None = Field(
        None, description="The most memory of the accelerator that it took.", examples=[7.5]
    )


class PublicSubmission(Strict):
    """What a board keeps and shows of a submission: all but whom to write to.

    Attributes
    ----------
    method : str
        Its name in tables; the folder has a plain name of its own.
    training_data : tuple of str
        Ids of datasets; empty for a method that was not trained.
    baseline : dict or None
        Settings of the track's built-in baseline, where that made the predictions.
    supersedes : str or None
        Ignored: earlier boards made the named folder the history of this one.
    """

    schema_version: Literal[1] = Field(
        alias="schema", description="Version of this format.", examples=[1]
    )
    protocol: Name = Field(
        description="What the predictions are scored by, one of the board's protocols.",
        examples=["airzoo-mini-retrieval"],
    )
    method: BoardName = Field(description="The method's name in tables.", examples=["SALAD"])
    summary: Annotated[str, Field(max_length=300), AfterValidator(plain_line)] | None = Field(
        None,
        description="What the method does, in a sentence.",
        examples=["DINOv2 features, aggregated by optimal transport"],
    )
    team: BoardName = Field(
        description="Who submits; the same words for all submissions of a team.",
        examples=["Example Lab"],
    )
    authors: Annotated[tuple[Line, ...], Field(min_length=1, max_length=100)] = Field(
        description="Of the method, in their order.",
        examples=[["Ada Example", "Grace Example"]],
    )
    date: datetime.date = Field(
        description="When the predictions were made, without quotes.",
        examples=[datetime.date(2026, 11, 22)],
    )
    paper: Url | None = Field(
        None, description="The method's paper.", examples=["https://arxiv.org/abs/2311.15937"]
    )
    bibtex: Bibtex | None = Field(
        None,
        description="How to cite the method, a BibTeX entry.",
        examples=["@inproceedings{key, title = {Title}, year = {2026}}"],
    )
    code: Url | None = Field(
        None,
        description="Open code that makes such predictions.",
        examples=["https://github.com/serizba/salad"],
    )
    weights: Url | None = Field(
        None,
        description="The weights that were used.",
        examples=["https://huggingface.co/example/salad"],
    )
    licence: Licence = Field(
        description="Under which others may use these predictions: an id or expression of SPDX.",
        examples=["CC-BY-4.0"],
    )
    training_data: Annotated[tuple[Name, ...], Field(max_length=100)] = Field(
        description="Ids of all datasets that any weights were trained on, as far as known; [] "
        "for a method without training.",
        examples=[["gsv-cities", "university-1652"]],
    )
    pipeline: Pipeline = Field(
        description="The class of the method.", examples=[{"stages": "single-stage", "uses": []}]
    )
    cost: Cost | None = Field(
        None,
        description="What an answer costs, as you measured it.",
        examples=[{"hardware": "1 x RTX 4090, 24 GB", "seconds_per_query": 0.042}],
    )
    baseline: Annotated[dict[Name, Setting], Field(max_length=32)] | None = Field(
        None,
        description="Only where `airzoo-bench baseline` made the predictions: its settings that "
        "are not the default. They can be made again, compared and timed.",
        examples=[{"double": False}],
    )
    predictions: PredictionsGiven = Field(
        description="Where the predictions lie, and their hash.",
        examples=[{"file": "predictions.npz", "sha256": "0" * 64, "bytes": 52431}],
    )
    supersedes: Name | None = Field(
        None,
        description="Ignored: withdraw the earlier submission, or put the new one in its folder.",
        examples=["salad-2025"],
    )


class Submission(PublicSubmission):
    """A method's predictions for one protocol, and what a reader of the board wants to know.

    Attributes
    ----------
    contact : str
        For the maintainers; it is shown nowhere.
    """

    contact: Contact = Field(
        description="Where the maintainers reach you; it is shown on no page, but this file is "
        "as public as its repository.",
        examples=["first.last@example.org"],
    )

    def public(self) -> PublicSubmission:
        """Return the same without the contact."""
        values = {name: getattr(self, name) for name in PublicSubmission.model_fields}
        return PublicSubmission.model_construct(**values)


def read_submission(path: Path) -> Submission:
    """Read a submission.toml."""
    return _read(path, Submission)


def read_public_submission(path: Path) -> PublicSubmission:
    """Read the submission.toml of a run, which has no contact."""
    return _read(path, PublicSubmission)


def _read(path: Path, model: type[P]) -> P:
    data = read_toml(path, SubmissionError, "submission file", _LIMIT_BYTES)
    return validated(data, model, SubmissionError, path, "submission file")


def submission_text(submission: PublicSubmission) -> str:
    """Return the file that states a submission, for `read_submission` or, of a run, the other."""
    values: dict[str, Any] = submission.model_dump(by_alias=True, exclude_none=True)
    return f"{SCHEMA_LINE}\n\n{tomli_w.dumps(_plain_first(values))}"


def _plain_first(values: dict[str, Any]) -> dict[str, Any]:
    # What stands below the head of a table belongs to it.
    return dict(sorted(values.items(), key=lambda item: isinstance(item[1], dict)))
