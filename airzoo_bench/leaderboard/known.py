"""What is on a board already, and whether a submission's names go with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.leaderboard.names import alike, fault_of_file_name, skeleton
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission

__all__ = [
    "Known",
    "Place",
    "check_names",
    "known_submissions",
]


@dataclass(frozen=True)
class Place:
    """Where a submission stands: ``submissions/<benchmark>/<track>/<folder>``."""

    benchmark: str
    track: str
    folder: str

    @classmethod
    def of(cls, folder: Path) -> Place:
        """Take it from the last three parts of a folder's path."""
        *_, benchmark, track, name = ("", "", "", *folder.resolve().parts)
        return cls(benchmark, track, name)

    @property
    def path(self) -> str:
        """Relative to the root of the board's repository."""
        return f"submissions/{self.benchmark}/{self.track}/{self.folder}"


@dataclass(frozen=True)
class Known:
    """A submission that is on the board; of its predictions, SHA-256 as it states."""

    benchmark: str
    track: str
    folder: str
    method: str
    team: str
    predictions: str = ""

    @property
    def place(self) -> Place:
        """Where it stands."""
        return Place(self.benchmark, self.track, self.folder)


def known_submissions(root: Path) -> list[Known]:
    """Return the submissions below a board's root that can be read, in the order of their paths."""
    found = []
    for path in sorted(root.glob(f"submissions/*/*/*/{SUBMISSION_FILE}")):
        place = Place.of(path.parent)
        if any(map(fault_of_file_name, astuple(place))):  # also one that is being written
            continue
        try:
            one = read_submission(path)
        except SubmissionError:  # its own check says so
            continue
        at = (place.benchmark, place.track, place.folder)
        found.append(Known(*at, one.method, one.team, one.predictions.sha256))
    return found


def check_names(
    submission: Submission, place: Place, known: Sequence[Known]
) -> Iterator[UserError | str]:
    """Yield errors and warnings of names."""
    others = [one for one in known if one.place != place]
    yield from _like_other(submission.team, "team", [one.team for one in others], "Your own team")
    of_others = [one for one in others if one.team != submission.team]
    yield from _like_other(
        submission.method, "method", [one.method for one in of_others], "The same method"
    )
    table = (place.benchmark, place.track)
    here = [one for one in others if (one.benchmark, one.track) == table]
    yield from _same_names(submission, here)
    for one in here:
        if one.predictions == submission.predictions.sha256 and one.team != submission.team:
            yield (
                f"the predictions are to the last byte those of {one.method!r} of team "
                f"{one.team!r}, in {one.folder}"
            )


def _like_other(name: str, key: str, names: list[str], same: str) -> Iterator[UserError]:
    for other in dict.fromkeys(names):
        if alike(name, other):
            yield SubmissionError(
                f"key '{key}' is {name!r}, which looks like {other!r} on this board",
                expected=f"a name that nobody takes for another's. {same} is written as there",
                fix=f"{key} = {other!r} if it is the same, else another name",
            )
            return


def _same_names(submission: Submission, here: list[Known]) -> Iterator[UserError | str]:
    for one in here:
        if skeleton(one.method) != skeleton(submission.method):
            continue
        if one.team == submission.team:
            yield SubmissionError(
                f"your team has a method {one.method!r} here already, in {one.folder}",
                expected="a name a row",
                fix=f'put the new version into {one.folder}, or name it such as "{one.method} v2"',
            )
        elif one.method == submission.method:
            yield f"{one.method!r} is on this board already, of team {one.team!r}, in {one.folder}"
