"""After a merge: what stands on the board's own branch is scored, where it has no run that counts.

A run counts while the submission's files, the protocol and the truth are the ones of today. Against
a sealed truth nothing is scored here, so the run of an earlier one stays, in a table of its own.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass
from itertools import chain
from pathlib import Path

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.checks import CheckedSubmission, check_submission
from airzoo_bench.leaderboard.ci.data_branch import DataBranch
from airzoo_bench.leaderboard.ci.entries import answer_path
from airzoo_bench.leaderboard.ci.git import Repository
from airzoo_bench.leaderboard.ci.outdated import Measures, measure_of
from airzoo_bench.leaderboard.ci.rules import BASE, read_files, submitted
from airzoo_bench.leaderboard.ci.scoring import OF_BOARD, Rules, is_sealed
from airzoo_bench.leaderboard.known import Place, check_names, known_submissions
from airzoo_bench.leaderboard.rescoring import Rescored, rescore
from airzoo_bench.leaderboard.runs import (
    RUN_FILE,
    Claimed,
    MadeAgain,
    newest_runs,
    read_run,
    write_facts,
)

__all__ = ["record_runs", "score_merged"]

_FETCHING_S = 3600.0
_NEW_TRY = "a new commit of the submission is a try at it"


@dataclass(frozen=True)
class Scored:
    """A submission of the board's branch, and what came of it.

    Attributes
    ----------
    place : Place
    run : Path or None
        Its newest run; None where there is a fault.
    said : str
        What was done, and why.
    fault : UserError or None
    """

    place: Place
    run: Path | None
    said: str
    fault: UserError | None = None


def score_merged(remote: str, rules: Rules, out: Path) -> Iterator[Scored]:
    """Score what stands on the board's branch and has no run that counts."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        repository = Repository.create(work / "board.git", remote)
        repository.fetch({f"refs/heads/{rules.branch}": BASE}, blobs=False, depth=1)
        branch = DataBranch.open(work / "data.git", remote)
        (out / "runs").mkdir(parents=True, exist_ok=True)
        commit = repository.resolve(BASE) or ""
        benchmarks = [one.name for one in rules.board.benchmarks]
        places = [
            *chain.from_iterable(submitted(repository, name, rules.note) for name in benchmarks)
        ]
        for place in places:
            # Runs of what was withdrawn stay on the branch, and leave the board.
            branch.export(out, f"runs/{place.benchmark}/{place.track}/{place.folder}")
        measures, until = Measures(rules.data), time.monotonic() + _FETCHING_S
        for place in places:
            tree = repository.resolve(f"{commit}:{place.path}") or ""
            run = _same_files(out, place, tree)
            why = "" if run is None else _outdated(run, measures, place, rules)
            if run is not None and (not why or is_sealed(rules.board, place)):
                if why:
                    yield Scored(place, run, f"not scored again: {why}; {_NEW_TRY}")
                continue
            new = _New(place, tree, commit, repository, branch, rules, work, until)
            try:
                yield Scored(place, new.score(out), f"scored again: {why}" if why else "scored")
            except UserError as fault:
                if isinstance(fault, OF_BOARD):
                    raise
                yield Scored(place, None, "", fault)


def _table(root: Path, place: Place) -> Path:
    return root / "runs" / place.benchmark / place.track


def _same_files(root: Path, place: Place, tree: str) -> Path | None:
    """Return the newest run, if it is of these files."""
    last = newest_runs(_table(root, place)).get(place.folder)
    return last if last is not None and read_run(last / RUN_FILE).tree == tree else None


def _outdated(run: Path, measures: Measures, place: Place, rules: Rules) -> str:
    measured = measure_of(run)
    now = measures.of(measured.protocol, sealed=is_sealed(rules.board, place))
    return measured.outdated(now)


@dataclass(frozen=True)
class _New:
    """A submission without a run."""

    place: Place
    tree: str
    commit: str
    repository: Repository
    branch: DataBranch
    rules: Rules
    work: Path
    until: float

    def score(self, out: Path) -> Path:
        """Write the run's folder."""
        last = newest_runs(_table(out, self.place)).get(self.place.folder)
        number = 1 if last is None else int(last.name) + 1
        run = _table(out, self.place) / self.place.folder / str(number)
        checked = self._checked(out)
        if is_sealed(self.rules.board, self.place):
            answer, found = self._answer(), None
            run.mkdir(parents=True)
            (run / "answer.json").write_bytes(answer)
        else:
            found = self._rescored(checked, run)
        assert checked.submission is not None  # what has no errors was read
        facts = _claimed(found), _made_again(found)
        write_facts(run, checked.submission, self.commit, self.tree, *facts)
        return run

    def _checked(self, out: Path) -> CheckedSubmission:
        limits = self.rules.board.limits
        faults = read_files(self.repository, self.commit, self.place, limits, self.work)
        if not faults:
            folder = self.work / self.place.path
            checked = check_submission(
                folder,
                self.rules.board,
                self.rules.data,
                fetch=True,
                until=self.until,
                run=self.rules.run,
            )
            faults = [*checked.errors, *self._faults_of_names(checked, out)]
        if faults:
            raise SubmissionError(faults[0].what, where=self.place.path, fix=faults[0].fix)
        return checked

    def _faults_of_names(self, checked: CheckedSubmission, out: Path) -> list[UserError]:
        """Hold names to those that came first: when this was looked at, these were not there."""
        given = checked.submission
        if given is None:
            return []
        scored = {path.parts[-4:-1] for path in out.glob("runs/*/*/*/*")}
        known = [one for one in known_submissions(self.rules.root) if astuple(one.place) in scored]
        found = (*check_names(given, self.place, known), *_check_case(self.place, scored))
        return [one for one in found if isinstance(one, UserError)]

    def _rescored(self, checked: CheckedSubmission, run: Path) -> Rescored:
        found = rescore(checked, data=self.rules.data, run=self.rules.run, make_again=True)
        if found.claimed is None and found.errors:
            raise found.errors[0]
        save(found.evaluation, run)
        return found

    def _answer(self) -> bytes:
        """Take the answer that was given before the merge, to the same files."""
        content = self.branch.read(answer_path(self.tree))
        if content is None:
            raise SubmissionError(
                "these files were not scored against the sealed truth before they were merged",
                where=self.place.path,
                fix="revert the merge; merge with `gh pr merge --match-head-commit` after the "
                "comment has the scores",
            )
        answer = SealedAnswer.model_validate_json(content)
        public = find_benchmark(self.place.benchmark, self.rules.data, sealed=True).file.sealed
        if public is None or answer.truth_commitment != public.commitment:
            raise SubmissionError(
                "these files were scored against an earlier truth, not the one that is sealed now",
                where=self.place.path,
                fix="let a new commit of the submission be scored",
            )
        return content


def _check_case(place: Place, scored: set[tuple[str, ...]]) -> Iterator[UserError]:
    own = astuple(place)
    for other in scored - {own}:
        if [part.casefold() for part in other] == [part.casefold() for part in own]:
            yield SubmissionError(
                f"differs from the folder {other[-1]} of the board only in case",
                fix="choose another name",
            )


def _claimed(found: Rescored | None) -> Claimed | None:
    if found is None or found.claimed is None:
        return None
    return Claimed(agrees=found.agrees, lines=tuple(found.lines))


def _made_again(found: Rescored | None) -> MadeAgain | None:
    if found is None or found.remade is None:
        return None
    queries = sum(counts["queries"] for counts in found.evaluation.result.counts.values())
    seconds = float(f"{found.remade.seconds / queries:.3g}")
    made = found.remade
    return MadeAgain(seconds_per_query=seconds, same_bytes=made.same_bytes, alike=made.alike)


def record_runs(branch: DataBranch, root: Path) -> list[str]:
    """Put runs onto the data branch that are not on it, and return their paths."""
    runs = sorted(path.parent for path in root.glob(f"runs/*/*/*/*/{RUN_FILE}"))

    def change(now: DataBranch) -> Mapping[str, bytes]:
        there = {run: now.read(f"{run.relative_to(root).as_posix()}/{RUN_FILE}") for run in runs}
        return {
            path.relative_to(root).as_posix(): path.read_bytes()
            for run in runs
            if there[run] is None
            for path in sorted(run.iterdir())
        }

    new = sorted({path.rsplit("/", 1)[0] for path in change(branch)})
    branch.write(change, f"runs: {', '.join(new)}")
    return new
