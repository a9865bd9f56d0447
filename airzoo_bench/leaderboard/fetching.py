"""Predictions by address: over https from public hosts, bounded in bytes and time, hashed."""

from __future__ import annotations

import hashlib
import http.client
import ipaddress
import re
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Timer
from typing import IO
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from airzoo_bench.core.errors import SubmissionError, printable
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.core.version import __version__

_CHUNK_BYTES = 1 << 16
_REDIRECTS, _MOVED = 5, (301, 302, 303, 307, 308)
_SLOWEST_BYTES_S, _CONNECT_S, _ANSWER_S = 250_000, 30.0, 60.0
# The address of the machine behind these is not the one that is seen.
_TUNNELS = tuple(map(ipaddress.ip_network, ("2002::/16", "192.88.99.0/24")))
_LABEL = r"(?!xn--)[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?"
# The last label begins with a letter, so no number in any base is taken for a name. Signed
# addresses of redirects are long.
_URL = re.compile(
    rf"https://(?=[a-z0-9.-]{{4,253}}(?:[:/?#]|\Z))(?:{_LABEL}\.)+(?=[a-z]){_LABEL}(?::443)?"
    r"(?:[/?#][!-\[\]-~]{0,8000})?",
    re.IGNORECASE,
)


def fetch(url: str, into: Path, *, size: int, sha256: str, seconds: float) -> Path:
    """Fetch a file of stated size and content into a folder, within some seconds."""
    address = parse_address(url)
    parts = reversed(unquote(address.path).split("/"))
    name = next((one for one in parts if "." in one and re.match(SAFE_NAME, one)), "predictions")
    target = into / name
    if target.is_file() and target.stat().st_size == size and sha256_of(target) == sha256:
        return target
    end = time.monotonic() + min(_ANSWER_S + size / _SLOWEST_BYTES_S, seconds)
    with atomic_write(target) as stream:
        for _ in range(_REDIRECTS + 1):
            with _answer(address, end) as answer:
                moved = answer.getheader("Location")
                if answer.status not in _MOVED or not moved:
                    _save(address, answer, stream, size, sha256)
                    return target
            address = parse_address(urljoin(address.geturl(), moved))
        raise SubmissionError(f"the address leads on more than {_REDIRECTS} times", where=url)


def parse_address(url: str) -> SplitResult:
    """Take an https address apart; its host is a plain name, its port 443."""
    if not _URL.fullmatch(url):
        expected = "https://HOST/PATH, where HOST is a name such as example.org"
        raise SubmissionError("no plain https address", where=printable(url), expected=expected)
    return urlsplit(url)


@contextmanager
def _answer(address: SplitResult, end: float) -> Iterator[http.client.HTTPResponse]:
    """Ask one address of a host, with the host's certificate; broken off at the end."""
    host, context = str(address.hostname), ssl.create_default_context()
    place = _public_address(host), 443
    try:
        plain = socket.create_connection(place, _CONNECT_S)
        with context.wrap_socket(
            plain, server_hostname=host, do_handshake_on_connect=False
        ) as peer:
            # Each read may take its time, and a host that drips would keep all of them going.
            left = max(end - time.monotonic(), 0.01)
            watchdog = Timer(left, socket.socket.shutdown, [peer, socket.SHUT_RDWR])
            watchdog.start()
            try:
                peer.do_handshake()
                connection = http.client.HTTPSConnection(host)
                connection.sock = peer
                path = (address.path or "/") + (f"?{address.query}" if address.query else "")
                headers = {"User-Agent": f"airzoo-bench/{__version__}", "Connection": "close"}
                connection.request("GET", path, headers=headers)
                with connection.getresponse() as answer:
                    yield answer
            finally:
                watchdog.cancel()
    except (OSError, http.client.HTTPException) as error:
        what = f"the host breaks off or cannot be reached ({printable(error)})"
        what = "the host is too slow" if time.monotonic() >= end else what
        raise SubmissionError(what, where=address.geturl()) from error


def _save(
    address: SplitResult, answer: http.client.HTTPResponse, stream: IO[bytes], size: int, sha: str
) -> None:
    """Write the answer of a host, if it is the stated file."""
    if answer.status != 200:
        fix = "see that anybody can open the address without logging in"
        what = f"the host answers {answer.status}"
        raise SubmissionError(what, where=address.geturl(), fix=fix)
    digest, seen = hashlib.sha256(), 0
    while seen <= size and (chunk := answer.read(_CHUNK_BYTES)):
        seen += len(chunk)
        digest.update(chunk)
        stream.write(chunk if seen <= size else b"")
    if seen < size and answer.length != 0:  # less than was announced, or broken off
        raise http.client.IncompleteRead(b"", answer.length)
    if seen != size or digest.hexdigest() != sha:
        found = f"SHA-256 {digest.hexdigest()}" if seen == size else f"{seen} bytes"
        what = f"the file there has {f'more than {size} bytes' if seen > size else found}"
        expected = f"{size} bytes of SHA-256 {sha}, as submission.toml states"
        raise SubmissionError(what, where=address.geturl(), expected=expected)


def _public_address(host: str) -> str:
    """Return the first address of a host; all must be public."""
    try:
        found = [str(one[4][0]) for one in socket.getaddrinfo(host, 443, type=socket.SOCK_STREAM)]
    except (OSError, UnicodeError) as error:
        raise SubmissionError(f"the host cannot be found ({error})", where=host) from None
    for text in found:
        address = ipaddress.ip_address(text)
        hidden = address.is_multicast or address.is_reserved
        if hidden or not address.is_global or any(address in network for network in _TUNNELS):
            what = f"the host's address {text} is not public"
            raise SubmissionError(what, where=host, fix="put the predictions on a public host")
    return found[0]
