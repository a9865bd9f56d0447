"""A challenge for EvalAI whose submissions its host scores, and what scores them."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from airzoo_bench.core.files import atomic_entries
from airzoo_bench.leaderboard.exports.bundle import Competition, logo, write_archive
from airzoo_bench.leaderboard.exports.evalai_worker import (
    FAILED_LABEL,
    PROGRAM,
    REFERENCE,
    error_label,
)
from airzoo_bench.leaderboard.exports.settings import ScoringSettings, fitted

__all__ = ["ENTRIES", "export_evalai"]

ENTRIES = ("challenge.zip", "worker")
"""What an export leaves in its folder."""

_PAGES = (
    "description",
    "evaluation_details",
    "terms_and_conditions",
    "submission_guidelines",
    "phase",
)
_TEXTS = (
    ("challenge_config.yaml", "evalai/challenge_config.yaml"),
    *((f"templates/{page}.html", f"evalai/{page}.html") for page in _PAGES),
)
_SCRIPT = (("__init__.py", "evalai/__init__.py"), ("main.py", "evalai/main.py"))
_ABOUT = "± is half of the width of the 95 % interval"


def export_evalai(competition: Competition, out: Path) -> list[Path]:
    """Write ``challenge.zip``, to upload, and the folder that the host's worker runs in.

    Parameters
    ----------
    competition : Competition
        Whose phases all end.
    out : Path
        A folder; files of an earlier export are replaced, all or none.

    Raises
    ------
    UserError
        The benchmark lacks files; the folder cannot be written.
    """
    with atomic_entries(out, ENTRIES) as staged:
        with tempfile.TemporaryDirectory(dir=staged) as folder:
            _write_challenge(competition, Path(folder))
            write_archive(staged / "challenge.zip", Path(folder))
        worker = staged / "worker"
        competition.write_scoring(worker / PROGRAM, worker / REFERENCE)
        script = [(f"evaluation_script/{name}", template) for name, template in _SCRIPT]
        competition.write_texts(worker, [("Dockerfile", "Dockerfile"), *script])
    return [out / name for name in ENTRIES]


def _write_challenge(competition: Competition, folder: Path) -> None:
    protocol = competition.protocol
    (folder / "logo.png").write_bytes(logo())
    competition.write_texts(
        folder,
        _TEXTS,
        name=fitted(protocol.title, 100),
        about=_ABOUT,
        split=protocol.name,
        schema=_leaderboard_schema(competition.settings),
        what="one prediction file, or an archive of a folder of prediction files",
    )
    script = folder / "evaluation_script"
    competition.write_texts(script, _SCRIPT)
    write_archive(folder / "evaluation_script.zip", script)
    shutil.rmtree(script)


def _leaderboard_schema(settings: ScoringSettings) -> dict[str, Any]:
    """Return EvalAI's description of a leaderboard: its labels, and which way each sorts."""
    columns = settings.columns
    titles = [column.title for column in columns]
    errors = [error_label(title) for title in titles]
    ascending = {column.title: not column.score.higher_is_better for column in columns}
    ascending |= dict.fromkeys([*errors, FAILED_LABEL], True)
    return {
        "labels": [*titles, *errors, FAILED_LABEL],
        "default_order_by": titles[0],
        "metadata": {
            label: {"sort_ascending": rises, "description": label}
            for label, rises in ascending.items()
        },
    }
