"""The pull request that an event is about, as GitHub describes it in JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import validation_message

__all__ = ["PullRequest", "read_event"]

Id = Annotated[int, Field(ge=1, lt=1 << 63)]
Commit = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]
Branch = Annotated[str, Field(min_length=1, max_length=255)]


@dataclass(frozen=True)
class PullRequest:
    """What of a pull request is acted upon.

    Attributes
    ----------
    number : int
    head : str
        The commit to score; none other is.
    ref : str
        Where the remote keeps it.
    base : str
        The branch that it is to be merged into.
    account : int
        Who made it, by the number that stays when a name changes.
    merged : bool
    """

    number: int
    head: str
    ref: str
    base: str
    account: int
    merged: bool


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class _Account(_Part):
    id: Id


class _Head(_Part):
    sha: Commit


class _Base(_Part):
    ref: Branch


class _Pull(_Part):
    number: Id
    head: _Head
    base: _Base
    user: _Account
    merged: bool = False


class _GitHubEvent(_Part):
    pull_request: _Pull


def read_event(path: Path) -> PullRequest:
    """Read the event of a pull request."""
    text = read_text(path, SubmissionError, "event")
    try:
        pull = _GitHubEvent.model_validate(json.loads(text)).pull_request
    except ValidationError as error:
        raise _fault(path, validation_message(error, _GitHubEvent)) from error
    except (ValueError, RecursionError) as error:
        raise _fault(path, f"no JSON: {error}") from error
    ref = f"refs/pull/{pull.number}/head"
    return PullRequest(
        pull.number, pull.head.sha, ref, pull.base.ref, pull.user.id, merged=pull.merged
    )


def _fault(path: Path, why: str) -> SubmissionError:
    return SubmissionError(
        f"not the event of a pull request: {why}",
        where=path,
        expected="what GitHub writes to $GITHUB_EVENT_PATH on pull_request_target",
    )
