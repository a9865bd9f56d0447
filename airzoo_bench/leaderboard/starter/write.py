"""Writing the files that a board begins with, into a folder where none of them is yet."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from airzoo_bench.core.errors import UsageError, first_of
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.schema import schema_text

__all__ = ["next_steps", "starter_files", "write_starter"]

_BOTH = {
    "leaderboard.toml": "leaderboard.toml",
    "get-data": ".ci/get-data",
    "gitattributes": ".gitattributes",
    "gitignore": ".gitignore",
    "README.md": "README.md",
    "SUBMITTING.md": "submissions/README.md",
}
_GITHUB = {
    "leaderboard.yml": ".github/workflows/leaderboard.yml",
    "board.yml": ".github/workflows/board.yml",
    "zizmor.yml": ".github/zizmor.yml",
    "CODEOWNERS": ".github/CODEOWNERS",
}
_GITLAB = {"gitlab-ci.yml": ".gitlab-ci.yml"}
_WORDS = {
    "github": {
        "@REQUEST@": "pull request",
        "@WHEN@": "Each push edits that comment.",
        "@USERS@": "https://api.github.com/users/NAME",
    },
    "gitlab": {
        "@REQUEST@": "merge request",
        "@WHEN@": "A maintainer starts each run.",
        "@USERS@": "https://gitlab.com/api/v4/users?username=NAME",
    },
}
_GITHUB_HOST = """\
url = "https://OWNER.github.io/REPOSITORY/"
repository = "OWNER/REPOSITORY\""""
_GITLAB_HOST = """\
# url = "https://..."  # Deploy > Pages shows it
repository = "OWNER/REPOSITORY"
gitlab = "https://gitlab.com\""""
_REQUIREMENTS = ".ci/requirements.txt"
_SCHEMA = "docs/submission.schema.json"  # each submission.toml names it to editors
_SCRIPTS = (".ci/get-data",)
_NAMED = ("leaderboard.toml", ".gitlab-ci.yml")


def starter_files(repository: str | None, *, gitlab: bool) -> dict[str, str]:
    """Return the content of each file, by its path.

    Parameters
    ----------
    repository : str or None
        Such as ``lab/board``.
    gitlab : bool
        Whether CI is GitLab's.
    """
    host, own = ("gitlab", _GITLAB) if gitlab else ("github", _GITHUB)
    words = _WORDS[host] | {"@HOST@": _host(repository, gitlab=gitlab)}
    found = {
        path: _filled((files(__package__) / "files" / group / name).read_text("utf-8"), words)
        for group, names in (("both", _BOTH), (host, own))
        for name, path in names.items()
    }
    if repository is not None:
        found |= {path: _named(found[path], repository) for path in found if path in _NAMED}
    found[_SCHEMA] = schema_text()
    found[_REQUIREMENTS] = (
        "# What scores submissions. Pin all of it: pip freeze > .ci/requirements.txt\n"
        f"airzoo-bench[leaderboard]=={__version__}\n"
    )
    return found


def write_starter(folder: Path, repository: str | None, *, gitlab: bool) -> list[Path]:
    """Write the files of a new board.

    Parameters
    ----------
    folder : Path
        Made where it is missing.
    repository : str or None
        Its name where it is hosted.
    gitlab : bool
        Whether CI is GitLab's.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    UsageError
        One of the files is there; then none is written. Or the name is none of a repository, or
        is missing for GitLab.
    """
    if repository is None and gitlab:
        raise UsageError(
            "on GitLab CI must know its own project, since it runs in no fork",
            fix="add --repository, such as --repository lab/board",
        )
    if repository is not None and not _is_repository(repository, gitlab=gitlab):
        raise UsageError(
            f"--repository {repository!r} is no name of a repository",
            expected="such as lab/vision/board" if gitlab else "such as lab/board",
        )
    content = starter_files(repository, gitlab=gitlab)
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


def next_steps(folder: Path, *, gitlab: bool) -> list[str]:
    """Return what is left to be done by hand, a line a step."""
    steps = [
        f"put your benchmark into {folder / 'leaderboard.toml'} and {folder / '.ci/get-data'}; "
        "they begin with AirZoo-Mini",
        f"pin all packages in {folder / _REQUIREMENTS}",
    ]
    if gitlab:
        steps += [
            f"do what the first lines of {folder / '.gitlab-ci.yml'} say: a protected branch, a "
            "token, protected variables, who may start a pipeline",
            "GitLab, Deploy > Pages: after the first pipeline it shows the address; put it into "
            f"{folder / 'leaderboard.toml'} as url",
        ]
    else:
        steps += [
            f"put your account into {folder / '.github/CODEOWNERS'}",
            "GitHub, Settings > Environments: make submissions and sealed, each with you as the "
            "required reviewer and main as the only branch; the key goes into sealed, as "
            "AIRZOO_BENCH_KEY",
            "GitHub, Settings > Pages: source GitHub Actions",
            "GitHub, Settings > Rules: main only by pull request, with a review of code owners; "
            "leaderboard-data without force pushes",
        ]
    return [f"{number}. {step}" for number, step in enumerate(steps, 1)]


def _is_repository(name: str, *, gitlab: bool) -> bool:
    parts = name.split("/")
    plain = "".join(parts).translate(str.maketrans("", "", "._-"))
    deep = len(parts) == 2 or (gitlab and len(parts) > 2)
    return deep and all(parts) and plain.isalnum() and plain.isascii()


def _host(repository: str | None, *, gitlab: bool) -> str:
    """Return where the board is hosted, in lines of its leaderboard.toml."""
    lines = _GITLAB_HOST if gitlab else _GITHUB_HOST
    return lines if repository is not None else "# " + lines.replace("\n", "\n# ")


def _filled(text: str, words: dict[str, str]) -> str:
    for word, shown in words.items():
        text = text.replace(word, shown)
    return text


def _named(text: str, repository: str) -> str:
    owner, _, name = repository.rpartition("/")
    return text.replace("OWNER", owner).replace("REPOSITORY", name)
