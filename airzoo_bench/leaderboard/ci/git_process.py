"""Running git: with its own settings, a token for one address, bounded output, and no shell."""

from __future__ import annotations

import base64
import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError

__all__ = ["TOKEN_VARIABLE", "BoardError", "GitProcess"]

TOKEN_VARIABLE = "GIT_TOKEN"
"""The variable of the environment with a token for the remote; it never stands in arguments."""

_KEPT = ("PATH", "HOME", "SSL_CERT_FILE", "GIT_SSL_CAINFO", "HTTPS_PROXY", "https_proxy", "TMPDIR")
_SETTINGS = {
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_ATTR_NOSYSTEM": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_ALLOW_PROTOCOL": "https:ssh:file",
    "LC_ALL": "C",
}
_TIMEOUT_S = 1800


class BoardError(SubmissionError):
    """The board, its data or its remote is not as it must be: no fault of a submission."""


@dataclass(frozen=True)
class GitProcess:
    """Git on a bare repository.

    Attributes
    ----------
    folder : Path
    remote : str
        The only address that is sent the token.
    """

    folder: Path
    remote: str

    def run(
        self, *arguments: str, stdin: bytes = b"", more: Mapping[str, str] | None = None
    ) -> bytes:
        """Return what a command prints."""
        done = self.call(*arguments, stdin=stdin, more=more)
        check(done, arguments[0])
        return done.stdout or b""

    def call(
        self,
        *arguments: str,
        stdin: bytes = b"",
        more: Mapping[str, str] | None = None,
        stdout: int = subprocess.PIPE,
    ) -> subprocess.CompletedProcess[bytes]:
        """Run a command that may fail."""
        try:
            return subprocess.run(
                self._line(arguments), input=stdin, env=self._environment() | dict(more or {}),
                stdout=stdout, stderr=subprocess.PIPE, timeout=_TIMEOUT_S, check=False,
            )  # fmt: skip
        except FileNotFoundError as error:
            raise BoardError("git is not installed", fix="install git 2.36 or later") from error
        except subprocess.TimeoutExpired as error:
            raise BoardError(
                f"git {arguments[0]} took longer than {_TIMEOUT_S} s", where=self.remote
            ) from error

    def first_bytes(self, limit: int, *arguments: str) -> tuple[bytes, bool]:
        """Return what a command prints, up to so many bytes, and whether it ended well."""
        with subprocess.Popen(
            self._line(arguments), env=self._environment(), stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        ) as process:  # fmt: skip
            text = process.stdout.read(limit) if process.stdout else b""
            if len(text) == limit:
                process.kill()
        return text, len(text) == limit or process.returncode == 0

    def _line(self, arguments: Sequence[str]) -> list[str]:
        return ["git", "-c", "core.hooksPath=/dev/null", f"--git-dir={self.folder}", *arguments]

    def _environment(self) -> dict[str, str]:
        kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
        token = os.environ.get(TOKEN_VARIABLE)
        if not token or not self.remote.startswith("https://"):
            return kept | _SETTINGS
        basic = base64.b64encode(f"x-access-token:{token}".encode()).decode("ascii")
        for_remote = {
            "GIT_CONFIG_COUNT": "1",
            "GIT_CONFIG_KEY_0": f"http.{self.remote}.extraHeader",
            "GIT_CONFIG_VALUE_0": f"Authorization: Basic {basic}",
        }
        return kept | _SETTINGS | for_remote


def check(done: subprocess.CompletedProcess[bytes], name: str) -> None:
    """Raise what git says of a command that failed."""
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip()[-500:]
        raise BoardError(f"git {name} failed: {said or f'exit code {done.returncode}'}")
