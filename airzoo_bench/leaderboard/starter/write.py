"""Writing the files that a board begins with, into a folder where none of them is yet."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from airzoo_bench.core.errors import UsageError, first_of
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.submission import schema_text

__all__ = ["next_steps", "starter_files", "write_starter"]

_FILES = {
    "leaderboard.toml": "leaderboard.toml",
    "get-data": ".ci/get-data",
    "gitattributes": ".gitattributes",
    "gitignore": ".gitignore",
    "README.md": "README.md",
    "SUBMITTING.md": "submissions/README.md",
    "leaderboard.yml": ".github/workflows/leaderboard.yml",
    "board.yml": ".github/workflows/board.yml",
    "zizmor.yml": ".github/zizmor.yml",
    "CODEOWNERS": ".github/CODEOWNERS",
}
_REQUIREMENTS = ".ci/requirements.txt"
_SCHEMA = "docs/submission.schema.json"  # each submission.toml names it to editors
_SCRIPTS = (".ci/get-data",)


def starter_files(repository: str | None) -> dict[str, str]:
    """Return the content of each file, by its path."""
    home = files(__package__) / "files"
    found = {path: (home / name).read_text("utf-8") for name, path in _FILES.items()}
    found["leaderboard.toml"] = found["leaderboard.toml"].replace("@HOST@", _host(repository))
    found[_SCHEMA] = schema_text()
    found[_REQUIREMENTS] = (
        "# What scores submissions. Pin all of it: pip freeze > .ci/requirements.txt\n"
        f"airzoo-bench[leaderboard]=={__version__}\n"
    )
    return found


def write_starter(folder: Path, repository: str | None) -> list[Path]:
    """Write the files of a new board."""
    if repository is not None and not re.fullmatch(r"[A-Za-z0-9._-]+/[A-Za-z0-9._-]+", repository):
        raise UsageError(
            f"--repository {repository!r} is no name of a repository", expected="such as lab/board"
        )
    content = starter_files(repository)
    there = [path for path in content if (folder / path).exists()]
    if there:
        raise UsageError(
            f"these files are there already, and none is replaced: {first_of(there)}",
            where=folder,
            fix="name another folder, or move them away",
        )
    for path, text in content.items():
        with atomic_write(folder / path, "w") as stream:
            stream.write(text)
        if path in _SCRIPTS:
            (folder / path).chmod(0o755)
    return [folder / path for path in content]


def next_steps(folder: Path) -> list[str]:
    """Return what is left to be done by hand, a line a step."""
    steps = [
        f"put your benchmark into {folder / 'leaderboard.toml'} and {folder / '.ci/get-data'}; "
        "they begin with AirZoo-Mini",
        f"pin all packages in {folder / _REQUIREMENTS}",
        f"put your account into {folder / '.github/CODEOWNERS'}",
        "GitHub, Settings > Environments: make submissions and sealed, each with you as the "
        "required reviewer and main as the only branch; the key goes into sealed, as "
        "AIRZOO_BENCH_KEY",
        "GitHub, Settings > Pages: source GitHub Actions",
        "GitHub, Settings > Rules: main only by pull request, with a review of code owners; "
        "leaderboard-data without force pushes",
    ]
    return [f"{number}. {step}" for number, step in enumerate(steps, 1)]


def _host(repository: str | None) -> str:
    """Return where the board is hosted, in lines of its leaderboard.toml."""
    owner, _, name = (repository or "OWNER/REPOSITORY").partition("/")
    off = "# " if repository is None else ""
    url = f'{off}url = "https://{owner}.github.io/{name}/"'
    return f'{url}\n{off}repository = "{owner}/{name}"'
