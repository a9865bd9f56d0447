"""Predictions by address: over https from public hosts, bounded in bytes and time, hashed."""

from __future__ import annotations

import hashlib
import http.client
import ipaddress
import re
import socket
import ssl
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import IO
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.core.version import __version__

_CHUNK_BYTES = 1 << 16
_REDIRECTS, _MOVED = 5, (301, 302, 303, 307, 308)
_LONGEST_URL = 8000  # signed addresses of redirects are long
_SLOWEST_BYTES_S, _LONGEST_S, _ANSWER_S = 250_000, 3600.0, 60.0
_LABEL = r"[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?"
# The last label begins with a letter, so no number in any base is taken for a name.
_HOST = re.compile(rf"(?=.{{4,253}}\Z)(?:{_LABEL}\.)+[a-z](?:[a-z0-9-]{{0,61}}[a-z0-9])(:443)?\Z")
_UNICAST = ipaddress.ip_network("2000::/3")
# The address of the machine behind these is not the one that is seen.
_TUNNELS = tuple(map(ipaddress.ip_network, ("2002::/16", "2001::/32", "192.88.99.0/24")))


def _system_addresses(host: str) -> list[str]:
    found = socket.getaddrinfo(host, 443, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(address[0]) for *_, address in found))


@dataclass(frozen=True)
class Network:
    """How hosts are found, reached and trusted."""

    resolve: Callable[[str], Sequence[str]] = _system_addresses
    reach: Callable[[str], tuple[str, int]] = lambda address: (address, 443)
    authority: Path | None = None


def fetch(
    url: str,
    into: Path,
    *,
    size: int,
    sha256: str,
    seconds: float = _LONGEST_S,
    network: Network = Network(),
) -> Path:
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
            with _answer(address, end, network) as answer:
                moved = answer.getheader("Location")
                if answer.status not in _MOVED or not moved:
                    _save(address, answer, stream, size, sha256)
                    return target
            address = parse_address(urljoin(address.geturl(), moved))
        raise SubmissionError(f"the address leads on more than {_REDIRECTS} times", where=url)


def parse_address(url: str) -> SplitResult:
    """Take an https address apart whose host is a plain name, and whose port is 443."""
    plain = len(url) <= _LONGEST_URL and re.fullmatch(r"[!-~]+", url) and "\\" not in url
    found = re.match("https://([^/?#]*)", url) if plain else None
    host = found[1].lower() if found else ""
    if not _HOST.match(host) or any(label.startswith("xn--") for label in host.split(".")):
        expected = "https://HOST/PATH, where HOST is a name such as example.org"
        raise SubmissionError("no plain https address", where=_printable(url), expected=expected)
    return urlsplit(url)


@contextmanager
def _answer(
    address: SplitResult, end: float, network: Network
) -> Iterator[http.client.HTTPResponse]:
    """Ask one address of a host, whose certificate must be the host's; broken off at the end."""
    host, left = str(address.hostname), end - time.monotonic()
    public = _public_address(host, network.resolve)
    context = ssl.create_default_context(cafile=network.authority)
    try:
        plain = socket.create_connection(network.reach(public), max(0.01, min(left, 30.0)))
        with context.wrap_socket(
            plain, server_hostname=host, do_handshake_on_connect=False
        ) as peer:
            # Each read may take its time, and a host that drips would keep all of them going.
            watchdog = Timer(max(left, 0.01), socket.socket.shutdown, [peer, socket.SHUT_RDWR])
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
        what = f"the host breaks off or cannot be reached ({_printable(str(error))})"
        what = "the host is too slow" if time.monotonic() >= end else what
        expected = f"a valid certificate, and {_SLOWEST_BYTES_S:,} bytes a second"
        raise SubmissionError(what, where=address.geturl(), expected=expected) from error


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


def _public_address(host: str, resolve: Callable[[str], Sequence[str]]) -> str:
    """Return the first address of a host; all must be public."""
    try:
        found = list(resolve(host))
    except (OSError, UnicodeError) as error:
        raise SubmissionError(f"the host cannot be found ({error})", where=host) from None
    if private := [address for address in found if not _is_public(address)]:
        what = f"the host's address {_printable(private[0])} is not public"
        raise SubmissionError(what, where=host, fix="put the predictions on a public host")
    return found[0]


def _is_public(text: str) -> bool:
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return False
    if address.is_multicast or address.is_reserved or not address.is_global:
        return False
    if any(address in network for network in _TUNNELS):
        return False
    return isinstance(address, ipaddress.IPv4Address) or address in _UNICAST


def _printable(text: str) -> str:
    """Return text of a stranger's machine, cut and without characters that a terminal obeys."""
    plain = "".join(letter if " " <= letter <= "~" else "?" for letter in text[:200])
    return plain + "..." * (len(text) > 200)
