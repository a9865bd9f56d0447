"""Answers: the numbers of scored submissions, which a board keeps, and the rows of board.json.

A run is the folder ``runs/<benchmark>/<track>/<folder>/<number>/`` with the answer in ``run.json``,
with ``submission.toml`` (without ``contact``) and, where the truth is public, with ``result.json``,
``records.csv`` and pictures. The highest number is shown; the others are history.
"""

from __future__ import annotations

import base64
import datetime
import re
import zlib
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import atomic_write, read_text, sha256_of
from airzoo_bench.leaderboard import submission
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.results.result import Result, ScoreColumn

RUN_FILE, RESULT_FILE, PICTURES_FILE = "run.json", "result.json", "figures/pictures.json"
FAULT_FILE = "fault.txt"  # why CI could not score the files that were merged last
TIME = "%Y-%m-%dT%H:%M:%SZ"  # in UTC

Number = float | None
Keep = Callable[[Any, Callable[[], Any]], Any]  # what is shown, and a function that makes it
Limits = tuple[Number, Number, Number]  # a value, and the ends of its interval
Hash = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]


class Model(BaseModel):
    """A part of board.json, in which an infinite number is the text "Infinity"."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


class Score(Model):
    """A score; `near_best` if a test of the two alone cannot tell the method from the best."""

    value: Number = None
    low: Number = None
    high: Number = None
    standard_error: Number = None
    rank: tuple[int, int] | None = None
    near_best: bool = False


class Version(Model):
    """A version of a submission: its overall scores, and where its run lies on the data branch."""

    number: int
    date: str
    scores: dict[str, Number]
    files: str


class Row(Model):
    """A method, or a floor such as chance; `scenes` and `conditions` are by name, then key."""

    id: str = ""
    kind: Literal["re-scored", "sealed", "reported", "floor", "failed"]
    method: str
    team: str = ""
    authors: tuple[str, ...] = ()
    summary: str = ""
    source: str = ""
    reason: str = ""
    date: str | None = None
    rescored: str | None = None
    version: int | None = None
    paper: str | None = None
    code: str | None = None
    weights: str | None = None
    licence: str | None = None
    training_data: tuple[str, ...] | None = None
    stages: str | None = None
    uses: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    scores: dict[str, Score] = {}
    scenes: dict[str, dict[str, Limits]] = {}
    conditions: dict[str, dict[str, tuple[Number, ...]]] = {}
    history: tuple[Version, ...] = ()  # the newest first


class Scene(Model):
    """A scene of a table."""

    id: str
    title: str
    queries: int | None


class Conditions(Model):
    """The groups of queries by a condition, and how many queries each has."""

    by: str
    title: str
    labels: tuple[str, ...]
    counts: tuple[int, ...]


class Head(Model):
    """The benchmark, protocol and truth of all numbers in a table."""

    benchmark: str
    benchmark_version: int | None = None
    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    truth: str = ""
    sealed: bool = False
    unit: str = "query"
    scenes: tuple[Scene, ...]


class Answer(Model):
    """The numbers of a submission; of a sealed truth there are neither floors nor values."""

    tree: Hash  # of the submission's files
    scored: str
    version: str
    head: Head
    columns: tuple[ScoreColumn, ...]
    row: Row
    floors: tuple[Row, ...] = ()
    about_intervals: str = ""
    conditions: tuple[Conditions, ...] = ()
    groups: tuple[tuple[str, int], ...] = ()  # names and sizes of the parts of values
    values: str = ""  # packed records (V, N), a row a headline score


def now() -> str:
    """Return the time in UTC, to the second."""
    return f"{datetime.datetime.now(datetime.UTC):{TIME}}"


def pack(values: NDArray[Any], kind: str) -> str:
    """Return numbers of a type of NumPy as a text: deflated, in base64."""
    return base64.b64encode(zlib.compress(values.astype(kind).tobytes(), 6)).decode()


# --- from a result ---


def make_row(
    overall: Mapping[str, float],
    scenes: Mapping[str, Mapping[str, float]],
    limits: Mapping[tuple[str, str], tuple[Number, Number]] = {},
    **facts: Any,
) -> Row:
    """Return a row with scores over all scenes and by scene, and the ends of their intervals."""

    def estimates(scene: str, values: Mapping[str, float]) -> dict[str, Limits]:
        return {k: (v, *limits.get((scene, k), (None, None))) for k, v in values.items()}

    every = estimates("", overall).items()
    scores = {key: Score(value=v, low=low, high=high) for key, (v, low, high) in every}
    of_scenes = {scene: estimates(scene, part) for scene, part in scenes.items()}
    return Row(scores=scores, scenes=of_scenes, **facts)


def head_of(result: Result) -> Head:
    """Return what a result measures."""
    truth, counts = result.truth, result.counts
    scenes = ((s, truth.scene_titles[s], counts[s]["queries"]) for s in result.scenes)
    facts = {"benchmark_version": truth.version, "truth": truth.fingerprint, "unit": result.unit}
    return make_head(truth.benchmark, result.track, result.protocol, scenes, **facts)


def make_head(
    benchmark: str, track: str, protocol: Any, scenes: Iterable[tuple[Any, ...]], **facts: Any
) -> Head:
    """Return the head of numbers by a protocol, on scenes of an id, a title and a count."""
    named = {f"protocol_{name}": getattr(protocol, name) for name in ("version", "fingerprint")}
    listed = tuple(Scene(id=s, title=title, queries=count) for s, title, count in scenes)
    facts |= {"benchmark": benchmark, "track": track, "protocol": protocol.name, "scenes": listed}
    return Head(**facts, **named)


# --- runs ---


def run_folders(folder: Path) -> list[Path]:
    """Return the folders of a submission's runs, the newest first."""
    found = folder.iterdir() if folder.is_dir() else ()
    numbers = [path for path in found if re.fullmatch(r"[1-9][0-9]{0,5}", path.name)]
    return sorted(numbers, key=lambda path: -int(path.name))


def next_run(folder: Path) -> Path:
    """Return the folder for another run of a submission."""
    return folder / str(max([int(path.name) for path in run_folders(folder)], default=0) + 1)


def write_run(run: Path, given: Submission, answer: Answer) -> None:
    """Write the submission and the answer of a run."""
    texts = {SUBMISSION_FILE: submission.submission_text(given, public=True)}
    for name, text in (texts | {RUN_FILE: answer.model_dump_json(indent=1) + "\n"}).items():
        with atomic_write(run / name, "w") as stream:
            stream.write(text)


def read_answer(path: Path) -> Answer:
    """Read an answer."""
    try:
        return Answer.model_validate_json(read_text(path, SubmissionError, "answer", 1 << 30))
    except ValidationError as error:
        fix = "score the submission again"
        raise SubmissionError("not the answer of this version", where=path, fix=fix) from error


# --- entries of tables ---


class Entry(Model):
    """A submission's row, without ranks; one that cannot be shown has a reason and no answer."""

    place: Place
    row: Row
    protocol: str = ""  # where submission.toml is readable
    answer: Answer | None = None


def read_entries(runs: Path, submissions: Path, keep: Keep) -> list[Entry]:
    """Read the submissions below a folder of runs, and those that have no run yet."""
    folders, found = [*runs.glob("*/*/*"), *submissions.glob("*/*/*")], []
    places = {Place.from_folder(path) for path in folders if path.is_dir()}
    for place in sorted(place for place in places if place.is_plain):
        folder, file = runs.joinpath(*place), submissions.joinpath(*place, SUBMISSION_FILE)
        files = [run / name for run in run_folders(folder) for name in (SUBMISSION_FILE, RUN_FILE)]
        files += [folder / FAULT_FILE, file]
        read = [[one.parent.name, one.exists(), one.is_file() and sha256_of(one)] for one in files]
        found.append(keep([place, read], partial(_read_entry, place, folder, file)))
    return [Entry.model_validate_json(text) for text in found if text]


def _read_entry(place: Place, folder: Path, file: Path) -> str:
    """Return the newest version that can be shown, else the reason why none can, as JSON."""
    fault, versions = folder / FAULT_FILE, list[tuple[Submission, Answer]]()
    reason = fault.read_text(encoding="utf-8").strip() if fault.is_file() else ""
    history = list[Version]()
    for run in run_folders(folder):
        try:
            stated = read_submission(run / SUBMISSION_FILE, public=True)
            versions.append((stated, answer := read_answer(run / RUN_FILE)))
        except UserError as error:
            if not versions:  # older ones are left out
                reason = reason or f"version {run.name}: {_reason(error)}"
            continue
        scores = {key: score.value for key, score in answer.row.scores.items()}
        number, date, files = int(run.name), answer.scored[:10], f"{place.runs}/{run.name}"
        history.append(Version(number=number, date=date, scores=scores, files=files))
    if versions:
        stated, answer = versions[0]
        facts = {"version": history[0].number, "rescored": history[0].date}
        notes = (f"a later version is not shown: {reason}",) if reason else ()
        facts |= {"history": tuple(history), "notes": answer.row.notes + notes}
        row = _with_facts(answer.row, stated, place, facts)
        return Entry(
            place=place, row=row, protocol=stated.protocol, answer=answer
        ).model_dump_json()
    row, protocol = Row(id=place.folder, kind="failed", method=place.folder), ""
    try:
        stated, reason = read_submission(file), reason or "not scored yet"
        row, protocol = _with_facts(row, stated, place, {}), stated.protocol
    except UserError as error:
        reason = reason or (_reason(error) if file.exists() else "")  # or it is withdrawn
    made = Entry(place=place, row=row.model_copy(update={"reason": reason}), protocol=protocol)
    return made.model_dump_json() if reason else ""


def _with_facts(row: Row, given: Submission, place: Place, facts: Mapping[str, Any]) -> Row:
    """Return a row with the facts that its submission states, and further ones."""
    said = {name: getattr(given, name) for name in Row.model_fields if hasattr(given, name)}
    said |= {"id": place.folder, "date": given.date.isoformat(), **dict(given.pipeline)}
    return row.model_copy(update=said | dict(facts))


def _reason(error: UserError) -> str:
    """Return what is wrong in one line, with the name of the file but not where it lies."""
    where = "" if error.where is None else f"{Path(str(error.where)).name}: "
    return f"{where}{error.what}".replace("\n", " ")
