"""What a submission states of itself, in ``submission.toml``."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Name, Positive, Strict, read_toml, validated

__all__ = [
    "SUBMISSION_FILE",
    "Cost",
    "Pipeline",
    "PredictionsGiven",
    "Submission",
    "read_submission",
]

SUBMISSION_FILE = "submission.toml"

Line = Annotated[str, Field(min_length=1, max_length=120)]
Url = Annotated[str, Field(pattern=r"^https://[^\s<>\"'`\\]+$", max_length=500)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class PredictionsGiven(Strict):
    """Where the predictions lie: next to submission.toml, or at an address.

    Attributes
    ----------
    sha256 : str
        Of the file; of a folder, as `core.files.sha256_of_tree` makes it.
    size : int
        In bytes, of all files.
    reader : str or None
        Who reads them, where they are not in the suite's own layout.
    names : str or None
        A list of image names next to submission.toml, see ``--names``.
    """

    file: Name | None = None
    url: Url | None = None
    sha256: Sha256
    size: Annotated[int, Field(ge=1, le=1 << 50, alias="bytes")]
    reader: Name | None = None
    names: Name | None = None

    @model_validator(mode="after")
    def _one_place(self) -> PredictionsGiven:
        if (self.file is None) == (self.url is None):
            raise ValueError("either file or url, not both and not neither")
        return self


class Pipeline(Strict):
    """What the method is: entries of different classes are not compared like with like."""

    stages: Literal["single-stage", "re-ranked"]
    uses: tuple[Literal["prior", "sequence", "heights"], ...] = ()


class Cost(Strict):
    """What a query costs, as the authors say."""

    hardware: Line
    seconds_per_query: Positive


class Submission(Strict):
    """A method's predictions for one protocol, and what a reader of the board wants to know.

    Attributes
    ----------
    method : str
        Its name in tables; the folder has a plain name of its own.
    contact : str
        For the maintainers; it is shown nowhere.
    training_data : tuple of str
        Ids of datasets.
    supersedes : str or None
        The folder of an earlier submission of the same team.
    """

    schema_version: Literal[1] = Field(alias="schema")
    protocol: Name
    method: Line
    team: Line
    contact: Line
    authors: Annotated[tuple[Line, ...], Field(min_length=1, max_length=100)]
    date: datetime.date
    paper: Url | None = None
    code: Url | None = None
    licence: Annotated[str, Field(pattern=r"^[A-Za-z0-9.+-]{1,64}$")]
    training_data: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    pipeline: Pipeline
    cost: Cost | None = None
    predictions: PredictionsGiven
    supersedes: Name | None = None


def read_submission(path: Path) -> Submission:
    """Read a submission.toml.

    Raises
    ------
    SubmissionError
        It is missing, no TOML, or has missing, unknown or malformed keys.
    """
    data = read_toml(path, SubmissionError, "submission file")
    return validated(data, Submission, SubmissionError, path, "submission file")
