"""EvalAI's API, as far as a host's worker needs it."""

from __future__ import annotations

import json
import re
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote, urlencode, urlsplit

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.core.version import __version__

__all__ = ["Api"]

_SILENCE_S = 60.0
_LONGEST_ANSWER = 16 << 20
_LARGEST_FILE = 4 << 30
_CHUNK_BYTES = 1 << 20
_THIS_MACHINE = ("localhost", "127.0.0.1", "::1")


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    # The token must not follow to another host.
    def redirect_request(self, *given: Any) -> None:
        del given


class Api:
    """A server of EvalAI, and the host's token.

    Parameters
    ----------
    server : str
        Such as ``https://eval.ai``.
    token : str

    Raises
    ------
    UsageError
        The server is reached without encryption, though it is not this machine.
    """

    def __init__(self, server: str, token: str) -> None:
        parts = urlsplit(server)
        if parts.scheme != "https" and (
            parts.scheme != "http" or parts.hostname not in _THIS_MACHINE
        ):
            raise UsageError(
                f"API_SERVER {server!r} would be sent the token without encryption",
                expected="https://eval.ai, or another https address",
            )
        self._server = server.rstrip("/")
        self._token = token
        self._opener = urllib.request.build_opener(_NoRedirect)

    def call(
        self, method: str, path: str, fields: Mapping[str, object] | None = None
    ) -> dict[str, Any]:
        """Call the API, and return its answer.

        Raises
        ------
        OSError, HTTPException, ValueError
            It cannot be reached, refuses, or answers no JSON object.
        """
        data = None if fields is None else urlencode(fields).encode()
        headers = {
            "Authorization": f"Bearer {self._token}",
            "User-Agent": f"airzoo-bench/{__version__}",
        }
        request = urllib.request.Request(self._server + path, data, headers, method=method)
        with self._opener.open(request, timeout=_SILENCE_S) as answer:
            found = json.loads(answer.read(_LONGEST_ANSWER))
        if not isinstance(found, dict):
            raise ValueError(f"{path} answers no JSON object")
        return found

    def download(self, url: str, folder: Path) -> Path:
        """Fetch a submission's file, without the token.

        Raises
        ------
        OSError, HTTPException, ValueError
            It cannot be fetched, or is too large.
        """
        if urlsplit(url).scheme not in ("http", "https"):
            raise ValueError("the submission's file is at no web address")
        name = unquote(urlsplit(url).path).rpartition("/")[2]
        path = folder / (name if re.match(SAFE_NAME, name) else "predictions")
        with urllib.request.urlopen(url, timeout=_SILENCE_S) as answer, path.open("wb") as stream:
            _copy(answer, stream)
        return path


def _copy(source: IO[bytes], target: IO[bytes]) -> None:
    seen = 0
    while chunk := source.read(_CHUNK_BYTES):
        seen += len(chunk)
        if seen > _LARGEST_FILE:
            raise ValueError(f"a submission of more than {_LARGEST_FILE:,} bytes")
        target.write(chunk)
