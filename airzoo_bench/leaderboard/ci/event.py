"""The pull request that an event is about, as GitHub or GitLab describe it in JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import validation_message

__all__ = ["PullRequest", "read_event", "read_events"]

Id = Annotated[int, Field(ge=1, lt=1 << 63)]
Commit = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]
Branch = Annotated[str, Field(min_length=1, max_length=255)]


@dataclass(frozen=True)
class PullRequest:
    """What of a pull request, or merge request, is acted upon.

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


class _MergeRequest(_Part):
    iid: Id
    sha: Commit
    target_branch: Branch
    author: _Account
    state: str = "opened"


def read_event(path: Path) -> PullRequest:
    """Read the event of a pull request (GitHub), or a merge request (GitLab's API).

    Raises
    ------
    SubmissionError
        It is missing, or is neither.
    """
    found = _read(path)
    if isinstance(found, PullRequest):
        return found
    raise _fault(path, "a list")


def read_events(path: Path) -> list[PullRequest]:
    """Read one event, or a list of GitLab's: the merge requests that a commit came by.

    Raises
    ------
    SubmissionError
        It is missing, or is neither.
    """
    found = _read(path)
    return [found] if isinstance(found, PullRequest) else found


def _read(path: Path) -> PullRequest | list[PullRequest]:
    text = read_text(path, SubmissionError, "event")
    try:
        data = json.loads(text)
        if isinstance(data, list):
            return [_gitlab(one) for one in data]
        return _gitlab(data) if isinstance(data, dict) and "iid" in data else _github(data)
    except ValidationError as error:
        raise _fault(path, validation_message(error, _GitHubEvent)) from error
    except (ValueError, RecursionError) as error:
        raise _fault(path, f"no JSON: {error}") from error


def _github(data: Any) -> PullRequest:
    pull = _GitHubEvent.model_validate(data).pull_request
    ref = f"refs/pull/{pull.number}/head"
    return PullRequest(
        pull.number, pull.head.sha, ref, pull.base.ref, pull.user.id, merged=pull.merged
    )


def _gitlab(data: Any) -> PullRequest:
    asked = _MergeRequest.model_validate(data)
    ref = f"refs/merge-requests/{asked.iid}/head"
    merged = asked.state == "merged"
    return PullRequest(
        asked.iid, asked.sha, ref, asked.target_branch, asked.author.id, merged=merged
    )


def _fault(path: Path, why: str) -> SubmissionError:
    return SubmissionError(
        f"not the event of a pull request: {why}",
        where=path,
        expected="what GitHub writes to $GITHUB_EVENT_PATH on pull_request_target, or a merge "
        "request of GitLab's API",
    )
