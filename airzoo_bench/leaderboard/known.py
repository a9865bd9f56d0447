"""What is on a board already, and whether a submission's names go with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.names import alike
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission

__all__ = ["Known", "Place", "check_names", "known_submissions"]


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
    """A submission that is on the board."""

    benchmark: str
    track: str
    folder: str
    method: str
    team: str

    @property
    def place(self) -> Place:
        """Where it stands."""
        return Place(self.benchmark, self.track, self.folder)


def known_submissions(root: Path) -> list[Known]:
    """Return the submissions below a board's root that can be read, in the order of their paths."""
    found = []
    for path in sorted(root.glob(f"submissions/*/*/*/{SUBMISSION_FILE}")):
        place = Place.of(path.parent)
        if place.folder.startswith("."):  # one that is being written
            continue
        try:
            one = read_submission(path)
        except SubmissionError:  # its own check says so
            continue
        found.append(Known(place.benchmark, place.track, place.folder, one.method, one.team))
    return found


def check_names(
    submission: Submission, place: Place, known: Sequence[Known]
) -> Iterator[UserError | str]:
    """Yield errors and warnings of names, and of the submission that is superseded.

    Parameters
    ----------
    submission : Submission
    place : Place
        Where it stands.
    known : sequence of Known
        All that is on the board; what stands at the same place is replaced, and so passed over.
    """
    others = [one for one in known if one.place != place]
    yield from _like_other(submission.team, "team", [one.team for one in others], "Your own team")
    of_others = [one for one in others if one.team != submission.team]
    yield from _like_other(
        submission.method, "method", [one.method for one in of_others], "The same method"
    )
    yield from _same_names(submission, place, others)
    if submission.supersedes is not None:
        yield from _superseded(submission, submission.supersedes, place, others)


def _like_other(name: str, key: str, names: list[str], same: str) -> Iterator[UserError]:
    for other in dict.fromkeys(names):
        if alike(name, other):
            yield SubmissionError(
                f"key '{key}' is {name!r}, which looks like {other!r} on this board",
                expected=f"a name that nobody takes for another's. {same} is written as there",
                fix=f"{key} = {other!r} if it is the same, else another name",
            )
            return


def _same_names(
    submission: Submission, place: Place, others: list[Known]
) -> Iterator[UserError | str]:
    for one in others:
        here = (one.benchmark, one.track) == (place.benchmark, place.track)
        if not here or one.method != submission.method or one.folder == submission.supersedes:
            continue
        if one.team == submission.team:
            yield SubmissionError(
                f"your team has a method {one.method!r} here already, in {one.folder}",
                expected="a name a row",
                fix=f'supersedes = "{one.folder}", or another name such as "{one.method} v2"',
            )
        else:
            yield f"{one.method!r} is on this board already, of team {one.team!r}, in {one.folder}"


def _superseded(
    submission: Submission, folder: str, place: Place, others: list[Known]
) -> Iterator[UserError]:
    here = {
        one.folder: one
        for one in others
        if (one.benchmark, one.track) == (place.benchmark, place.track)
    }
    if folder not in here:
        yield SubmissionError(
            f"key 'supersedes' is {folder!r}, which is not there{nearest(folder, [*here])}",
            expected=f"a folder of submissions/{place.benchmark}/{place.track}, not this one",
            fix="correct the name, or leave out the key",
        )
    elif here[folder].team != submission.team:
        yield SubmissionError(
            f"key 'supersedes' is {folder!r}, of team {here[folder].team!r}",
            expected=f"a submission of {submission.team!r}, the team of this one",
            fix="write the team as before, or leave out the key",
        )
