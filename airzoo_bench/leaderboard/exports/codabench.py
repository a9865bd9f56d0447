"""A competition bundle for Codabench, version 2, with an image to score in."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_entries
from airzoo_bench.leaderboard.exports.bundle import Competition, logo, write_archive
from airzoo_bench.leaderboard.exports.settings import FAILED, fitted

__all__ = ["ENTRIES", "export_codabench"]

ENTRIES = ("competition.zip", "Dockerfile")
"""What an export leaves in its folder."""

_TEXTS = (
    ("competition.yaml", "codabench/competition.yaml"),
    ("scoring_program/metadata.yaml", "codabench/metadata.yaml"),
    ("overview.md", "overview.md"),
    ("evaluation.md", "evaluation.md"),
    ("submitting.md", "submitting.md"),
    ("terms.md", "terms.md"),
)
_IMAGE = re.compile(r"[a-z0-9][A-Za-z0-9._/:@-]{0,127}\Z")


def export_codabench(
    competition: Competition, out: Path, *, docker_image: str, seconds: int
) -> list[Path]:
    """Write ``competition.zip``, to upload, and the Dockerfile of the image that scores.

    Parameters
    ----------
    competition : Competition
    out : Path
        A folder; files of an earlier export are replaced, all or none.
    docker_image : str
        Where the image will lie that is built of the Dockerfile.
    seconds : int
        That scoring may take.

    Raises
    ------
    UserError
        The image's name is none; the benchmark lacks files; the folder cannot be written.
    """
    if not _IMAGE.match(docker_image):
        raise UsageError(
            f"--docker-image {docker_image!r} is no name of an image",
            expected="at most 128 characters, such as registry.example.org/team/airzoo-bench:1",
        )
    with atomic_entries(out, ENTRIES) as staged:
        with tempfile.TemporaryDirectory(dir=staged) as folder:
            _write_bundle(competition, Path(folder), docker_image, seconds)
            write_archive(staged / "competition.zip", Path(folder))
        competition.write_texts(staged, [("Dockerfile", "Dockerfile")])
    return [out / name for name in ENTRIES]


def _write_bundle(competition: Competition, folder: Path, docker_image: str, seconds: int) -> None:
    competition.write_scoring(folder / "scoring_program", folder / "reference_data")
    (folder / "logo.png").write_bytes(logo())
    competition.write_texts(
        folder,
        _TEXTS,
        docker_image=docker_image,
        seconds=seconds,
        failed=FAILED,
        leaderboard_title=fitted(competition.protocol.title, 64),
        leaderboard_key=fitted(competition.protocol.name, 36),
        what="a zip with one prediction file, or with one folder of prediction files",
    )
