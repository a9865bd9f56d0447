"""What storage answers instead of content: tried again where that helps, else one message."""

from __future__ import annotations

import errno
import re
import sys
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage.urls import Url

__all__ = ["DISK_FAULTS", "ShortAnswerError", "tried"]

T = TypeVar("T")

PAUSES_S = (0.2, 0.5, 1.0, 2.0)
"""Before each further try."""
DISK_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.ENAMETOOLONG, errno.EROFS)
"""What the disk of this machine refuses."""
_PASSING = (408, 425, 429, 500, 502, 503, 504)
_EXPIRED = ("ExpiredToken", "ExpiredTokenException", "RequestExpired", "TokenRefreshRequired")
_WRONG_KEYS = ("InvalidAccessKeyId", "SignatureDoesNotMatch", "InvalidToken")
# What clients raise beside OSError; each is asked for only if its client was imported.
_CLASSES = {
    "aiohttp": ("ClientError",),
    "botocore.exceptions": ("BotoCoreError", "ClientError"),
    "gcsfs.retry": ("HttpError",),
    "google.auth.exceptions": ("GoogleAuthError",),
    "httpx": ("HTTPError", "InvalidURL"),
    "huggingface_hub.errors": ("HfHubHTTPError", "HFValidationError", "LocalTokenNotFoundError"),
}
# How aiohttp calls an answer that breaks off; the 400 in it is its own, and no server's.
_NO_HTTP = "HttpProcessingError"
_UNREACHABLE = (
    *("ClientConnectionError", "EndpointConnectionError", "ConnectTimeoutError", "ConnectError"),
    *("ReadTimeoutError", "TransportError", "ConnectionClosedError", "HTTPClientError"),
    *("ClientPayloadError", "IncompleteReadError", _NO_HTTP),
)
_LOGIN = re.compile(r"//[^/\s]*@")
_CREDENTIALS = {
    "s3": "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, of somebody who may; "
    "AWS_NO_SIGN_REQUEST=YES for a public bucket",
    "gs": "GOOGLE_APPLICATION_CREDENTIALS, the key file of somebody who may",
    "hf": "HF_TOKEN, or log in with `hf auth login`; for gated data, ask for access on its page",
    "https": "use an address that needs no login, or a signed one",
}


class ShortAnswerError(OSError):
    """Fewer bytes came than were asked for."""


def tried(url: Url, call: Callable[[], T]) -> T:
    """Call a client, again where its storage is busy or out of reach for a moment."""
    for pause in (*PAUSES_S, None):
        try:
            return call()
        except _errors() as error:
            if getattr(error, "errno", None) in DISK_FAULTS:
                raise
            if pause is None or not _may_pass(error):
                raise explained(url, error) from error
        time.sleep(pause)
    raise AssertionError("the last try returns or raises")  # pragma: no cover


def _errors() -> tuple[type[Exception], ...]:
    return (OSError, *_of_clients())


def _of_clients() -> Iterator[type[Exception]]:
    for name, classes in _CLASSES.items():
        module = sys.modules.get(name)
        yield from (getattr(module, one) for one in classes if hasattr(module, one))


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _status(error: BaseException) -> int | None:
    """Return the HTTP status that an error, or what caused it, states."""
    if _NO_HTTP in _kinds(error):
        return None
    for one in _chain(error):
        response = getattr(one, "response", None)
        if isinstance(response, dict):  # botocore
            stated = response.get("ResponseMetadata", {}).get("HTTPStatusCode")
        else:
            stated = getattr(one, "status", None) or getattr(response, "status_code", None)
            stated = stated or getattr(one, "code", None)
        if str(stated).isdigit():
            return int(str(stated))
    return None


def _code(error: BaseException) -> str:
    """Return S3's word for an error."""
    for one in _chain(error):
        response = getattr(one, "response", None)
        if isinstance(response, dict):
            return str(response.get("Error", {}).get("Code", ""))
    return ""


def _kinds(error: BaseException) -> set[str]:
    return {kind.__name__ for one in _chain(error) for kind in type(one).__mro__}


def _is_unreachable(error: BaseException) -> bool:
    kinds = _kinds(error)
    ours = (ConnectionError, TimeoutError, ShortAnswerError)
    return not kinds.isdisjoint(_UNREACHABLE) or any(isinstance(one, ours) for one in _chain(error))


def _may_pass(error: BaseException) -> bool:
    status = _status(error)
    return status in _PASSING or (status is None and _is_unreachable(error))


def explained(url: Url, error: BaseException) -> StorageError:
    """Return the message of what a client raised."""
    status, code = _status(error), _code(error)
    kinds = _kinds(error)
    credentials = _CREDENTIALS.get(url.scheme, _CREDENTIALS["https"])
    if code in _EXPIRED:
        return StorageError("the credentials have expired", where=url, fix=f"renew {credentials}")
    if code in _WRONG_KEYS:
        return StorageError("the credentials are not valid", where=url, fix=credentials)
    if not kinds.isdisjoint(("NoCredentialsError", "DefaultCredentialsError", "RefreshError")):
        return StorageError("no credentials are set for this storage", where=url, fix=credentials)
    if status in (401, 403) or isinstance(error, PermissionError):
        return StorageError("access is denied", where=url, fix=credentials)
    if status in _PASSING:
        return _gave_up(url, f"answered {status}, {len(PAUSES_S) + 1} times")
    if _is_unreachable(error):
        return _gave_up(url, f"cannot be reached: {_said(error)}")
    if status == 404 or isinstance(error, FileNotFoundError):
        return StorageError(
            "no such file or folder", where=url, fix="check bucket, name, and the endpoint if any"
        )
    return StorageError(f"the storage refuses: {_said(error)}", where=url)


def _gave_up(url: Url, what: str) -> StorageError:
    return StorageError(
        what,
        where=url,
        fix="run this again later: what came whole is kept; where it stays so, check the network "
        "and the endpoint (AWS_ENDPOINT_URL)",
    )


def _said(error: BaseException) -> str:
    """Return a client's words, of whose URLs neither passwords nor signatures are shown."""
    shown = _LOGIN.sub("//", str(error).split("?")[0])
    return " ".join(shown.split())[:200] or type(error).__name__
