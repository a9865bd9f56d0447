"""What is on a board already, and whether a submission's names go with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.names import alike, skeleton
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission

__all__ = [
    "Known",
    "Place",
    "check_brought_back",
    "check_names",
    "check_superseded",
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
    supersedes: str | None = None
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
        if place.folder.startswith("."):  # one that is being written
            continue
        try:
            one = read_submission(path)
        except SubmissionError:  # its own check says so
            continue
        at = (place.benchmark, place.track, place.folder)
        sha256 = one.predictions.sha256
        found.append(Known(*at, one.method, one.team, one.supersedes, sha256))
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
    here = _of_table(others, place)
    yield from _same_names(submission, place.folder, here)
    for one in here.values():
        if one.predictions == submission.predictions.sha256 and one.team != submission.team:
            yield (
                f"the predictions are to the last byte those of {one.method!r} of team "
                f"{one.team!r}, in {one.folder}"
            )
    yield from _line_of_versions(submission, place.folder, here)
    yield from check_superseded(submission, place, known)
    yield from check_brought_back(known, place, submission.supersedes)


def _of_table(known: Sequence[Known], place: Place) -> dict[str, Known]:
    """Return the other submissions of a place's table by their folders."""
    table = (place.benchmark, place.track)
    return {
        one.folder: one
        for one in known
        if (one.benchmark, one.track) == table and one.folder != place.folder
    }


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
    submission: Submission, folder: str, here: dict[str, Known]
) -> Iterator[UserError | str]:
    older = {submission.supersedes, *(one.supersedes for one in here.values())}
    if folder in older:  # it has no row
        return
    for one in here.values():
        if one.folder in older or skeleton(one.method) != skeleton(submission.method):
            continue
        if one.team == submission.team:
            yield SubmissionError(
                f"your team has a method {one.method!r} here already, in {one.folder}",
                expected="a name a row",
                fix=f'supersedes = "{one.folder}", or another name such as "{one.method} v2"',
            )
        elif one.method == submission.method:
            yield f"{one.method!r} is on this board already, of team {one.team!r}, in {one.folder}"


def _line_of_versions(
    submission: Submission, folder: str, here: dict[str, Known]
) -> Iterator[UserError]:
    """Refuse what would make two lines, or a circle, of submissions that supersede each other."""
    heirs = {one.supersedes: one for one in here.values() if one.supersedes is not None}
    if folder in heirs and heirs[folder].team != submission.team:
        yield SubmissionError(
            f"{heirs[folder].folder} of team {heirs[folder].team!r} supersedes this submission",
            expected="both of one team",
            fix="write the team as before",
        )
    if submission.supersedes in heirs:
        yield SubmissionError(
            f"key 'supersedes' is {submission.supersedes!r}, which "
            f"{heirs[submission.supersedes].folder} supersedes already",
            expected="the newest of your submissions",
            fix=f'supersedes = "{heirs[submission.supersedes].folder}"',
        )
    seen = {folder}
    last = submission.supersedes
    while last in here and last not in seen:
        seen.add(last)
        last = here[last].supersedes
    if last == folder and submission.supersedes != folder:
        yield SubmissionError(
            f"key 'supersedes' is {submission.supersedes!r}, which supersedes this submission",
            expected="an earlier submission",
            fix="leave out the key",
        )


def check_brought_back(
    known: Sequence[Known], place: Place, supersedes: str | None = None
) -> Iterator[UserError]:
    """Yield an error where a row comes back beside one that has taken its name since.

    Parameters
    ----------
    known : sequence of Known
        All that is on the board, with what stands at the place until now.
    place : Place
        Of a submission that is changed or withdrawn.
    supersedes : str or None
        What it supersedes from now on.
    """
    here = _of_table(known, place)
    old = next((one.supersedes for one in known if one.place == place), None)
    gone = {supersedes, *(one.supersedes for one in here.values())}
    if old is None or old in gone or old not in here:
        return
    back = here[old]
    for one in here.values():
        same = one.team == back.team and skeleton(one.method) == skeleton(back.method)
        if same and one is not back and one.folder not in gone:
            yield SubmissionError(
                f"would bring {back.folder} back beside {one.folder}, and both are called "
                f"{one.method!r}",
                where=place.path,
                expected="a name a row",
                fix=f"withdraw {back.folder} first, or give one of them another name",
            )


def check_superseded(
    submission: Submission, place: Place, known: Sequence[Known]
) -> Iterator[UserError]:
    """Yield an error where there is nothing that it may supersede; see `check_names`."""
    folder, here = submission.supersedes, _of_table(known, place)
    if folder is None:
        return
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
