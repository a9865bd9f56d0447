"""What a run leaves in its folder, in place of what an earlier run left there."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import atomic_entries, check_output_folder
from airzoo_bench.results.result import Result, read_result, write_result

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["RESULT_FILES", "RUN_FILES", "Evaluation", "earlier_run", "save"]

RUN_FILES = ("result.json", "records.csv", "timings.csv", "alignment.json", "figures", "clouds")
"""What a run can leave in its folder."""

RESULT_FILES = RUN_FILES[:4]
"""Those of `RUN_FILES` that are files."""


@dataclass(frozen=True)
class Evaluation:
    """A result and the records that it was made from."""

    result: Result
    records: pd.DataFrame


def save(evaluation: Evaluation, folder: Path, *writers: Callable[[Path], None]) -> list[Path]:
    """Write ``result.json`` and ``records.csv`` into a folder, in place of an earlier run's files.

    Everything is written first, then exchanged in one step: nothing of the two runs is ever mixed.

    Parameters
    ----------
    evaluation : Evaluation
    folder : Path
        What is not of `RUN_FILES` stays.
    writers : callables
        Each takes a folder and writes one more of `RUN_FILES` into it.

    Returns
    -------
    list of Path
        The files, in the order of `RUN_FILES`.
    """
    check_output_folder(folder, RESULT_FILES)
    content = evaluation.records.to_csv(index=False, lineterminator="\n").encode()
    result = evaluation.result.with_records(hashlib.sha256(content).hexdigest())
    with atomic_entries(folder, RUN_FILES) as staged:
        (staged / "records.csv").write_bytes(content)
        write_result(staged / "result.json", result)
        for write in writers:
            write(staged)
        return [folder / name for name in RUN_FILES if (staged / name).exists()]


def earlier_run(folder: Path) -> str | None:
    """Say which run has left its files in a folder, where `save` will replace them."""
    names = ", ".join(name for name in RUN_FILES if (folder / name).exists())
    if not names:
        return None
    try:
        found = read_result(folder / "result.json")
    except ResultError:  # none, or one that nobody can read any more
        return f"{folder} holds files of a run; {names} will be replaced"
    written = datetime.fromtimestamp((folder / "result.json").stat().st_mtime)
    return (
        f"{folder} holds a run of the {found.track} track: {found.predictions.method} by "
        f"{found.protocol.name} v{found.protocol.version}, written {written:%Y-%m-%d %H:%M}; "
        f"{names} will be replaced"
    )
