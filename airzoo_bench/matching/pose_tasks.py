"""The poses of a scene's queries, solved as tasks that any engine may do.

Queries differ a hundredfold in work: RANSAC draws on where few matches agree. So tasks are small,
and whoever is done with one takes the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.matching.pose import PoseProblem, PoseSettings, solve_poses
from airzoo_bench.matching.solvers import PoseEstimate, Status

__all__ = ["PoseQueries", "Solved", "solve_queries"]

# A query may take ten seconds, and photos taken one after the other are hard together: each is a
# task, and the engine sends short ones together. Only of very many queries some go into one.
_TASKS, _QUERIES_A_TASK = 10_000, 64
_QUERIES_A_THREAD = 16
_STATUSES = tuple(Status)


@dataclass(frozen=True, eq=False)
class PoseQueries(Sequence[PoseProblem]):
    """Queries whose poses are to be found; their problems are made as they are asked for.

    Attributes
    ----------
    name : str
        What they are called in messages.
    cameras : Cameras
        Of Q queries.
    offsets : (Q + 1,) int64
        Query q has the matches ``offsets[q]:offsets[q + 1]``; the first is 0.
    query_xy : (M, 2) float64
    points : (M, 3) float64
    """

    name: str
    cameras: Cameras
    offsets: Ints
    query_xy: Floats
    points: Floats

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @overload
    def __getitem__(self, index: int) -> PoseProblem: ...
    @overload
    def __getitem__(self, index: slice) -> PoseQueries: ...
    def __getitem__(self, index: int | slice) -> PoseProblem | PoseQueries:
        if isinstance(index, int):
            if not 0 <= index < len(self):
                raise IndexError(index)
            one = slice(*self.offsets[index : index + 2].tolist())
            return PoseProblem(self.cameras.take(index), self.query_xy[one], self.points[one])
        first, stop, _ = index.indices(len(self))
        some = slice(*self.offsets[[first, stop]].tolist())
        return PoseQueries(
            f"queries {first + 1:,} to {stop:,} of {self.name}",
            self.cameras.take(index),
            self.offsets[first : stop + 1] - self.offsets[first],
            self.query_xy[some],
            self.points[some],
        )


class Solved(NamedTuple):
    """What was found of Q queries with M matches.

    Attributes
    ----------
    rotations : (Q, 3, 3) array
    centres : (Q, 3) array
        NaN on failure, as rotations are.
    status : list of Q str
    inliers : (M,) bool array
    left_out : (Q,) int array
    seconds : (Q,) array
        See `PoseEstimate` for all of them.
    """

    rotations: Floats
    centres: Floats
    status: list[str]
    inliers: Bools
    left_out: Ints
    seconds: Floats


class _Shared(NamedTuple):
    settings: PoseSettings
    jobs: int
    progress: Progress


def solve_queries(queries: PoseQueries, settings: PoseSettings, resources: Resources) -> Solved:
    """Solve for the poses of queries, wherever the engine has it done."""
    size = _queries_a_task(len(queries), resources.jobs)
    blocks = [queries[cut] for cut in resources.engine.cut(len(queries), size)]
    # Where all is one task, it shows how far it is; tasks are shown by the engine.
    progress = resources.progress if len(blocks) == 1 else silent
    found = resources.engine.map(
        _solve_block,
        blocks,
        shared=_Shared(settings, resources.jobs, progress),
        stage="blocks of queries",
        name=lambda block: block.name,
    )
    return _joined([_as_arrays([]), *found])


def _queries_a_task(count: int, jobs: int) -> int:
    size = min(_QUERIES_A_TASK, max(1, count // _TASKS))
    return size if jobs == 1 else max(size, _QUERIES_A_THREAD * jobs)


def _solve_block(shared: _Shared, block: PoseQueries) -> dict[str, NDArray[Any]]:
    found = solve_poses(block, jobs=shared.jobs, progress=shared.progress, **shared.settings)
    return _as_arrays(found)


def _as_arrays(found: list[PoseEstimate]) -> dict[str, NDArray[Any]]:
    inliers = np.concatenate([np.zeros(0, np.bool_), *(one.inliers for one in found)])
    return {
        "rotations": np.array([one.rotation for one in found]).reshape(-1, 3, 3),
        "centres": np.array([one.centre for one in found]).reshape(-1, 3),
        "status": np.array([_STATUSES.index(one.status) for one in found], np.uint8),
        "matches": np.array([len(inliers)]),
        "inliers": np.packbits(inliers),  # an eighth on its way back
        "left_out": np.array([one.left_out for one in found], np.int64),
        "seconds": np.array([one.seconds for one in found], np.float64),
    }


def _joined(results: list[dict[str, NDArray[Any]]]) -> Solved:
    """Put the results of blocks one after the other."""
    inliers = [np.unpackbits(one["inliers"], count=int(one["matches"][0])) for one in results]
    joined = {name: np.concatenate([one[name] for one in results]) for name in results[0]}
    return Solved(
        joined["rotations"],
        joined["centres"],
        [_STATUSES[code].value for code in joined["status"].tolist()],
        np.concatenate(inliers).astype(np.bool_),
        joined["left_out"],
        joined["seconds"],
    )
