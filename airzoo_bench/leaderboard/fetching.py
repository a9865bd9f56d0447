"""Predictions by address: over https from public hosts, bounded in bytes and time, hashed."""

from __future__ import annotations

import hashlib
import http.client
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, counted
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.addresses import (
    HTTPS_PORT,
    WebAddress,
    public_addresses,
    shown,
    system_resolver,
)

__all__ = ["Network", "Patience", "fetch"]

_CHUNK_BYTES = 1 << 16
_REDIRECTS = 5
_MOST_ADDRESSES = 4
_MOVED = {301, 302, 303, 307, 308}


@dataclass(frozen=True)
class Patience:
    """How long a host may take, in seconds.

    Attributes
    ----------
    silence : float
        Without a byte.
    answer : float
        From the connection to the end of the headers.
    slowest : float
        Bytes a second, on average over a file.
    longest : float
        For a file of whatever size, with all redirects.
    """

    silence: float = 30.0
    answer: float = 60.0
    slowest: float = 250_000.0
    longest: float = 3600.0

    def of_file(self, size: int) -> float:
        """Seconds for a file of so many bytes."""
        return min(self.answer + size / self.slowest, self.longest)


def _connect(address: str, timeout: float) -> socket.socket:
    return socket.create_connection((address, HTTPS_PORT), timeout)


@dataclass(frozen=True)
class Network:
    """How hosts are found, reached and trusted; the defaults are the system's.

    Attributes
    ----------
    resolve : callable
        From a host to its addresses.
    connect : callable
        From an address and seconds to a socket.
    trust : SSLContext
        Whose certificates are believed; it checks the host's name.
    """

    resolve: Callable[[str], Sequence[str]] = system_resolver
    connect: Callable[[str, float], socket.socket] = _connect
    trust: ssl.SSLContext = field(default_factory=ssl.create_default_context)
    patience: Patience = Patience()


def fetch(
    url: str,
    into: Path,
    *,
    size: int,
    sha256: str,
    network: Network | None = None,
    until: float | None = None,
) -> Path:
    """Fetch a file of stated size and content into a folder."""
    place = WebAddress.parse(url)
    target = into / place.file_name
    if target.is_file() and target.stat().st_size == size and sha256_of(target) == sha256:
        return target
    chosen = Network() if network is None else network
    end = time.monotonic() + chosen.patience.of_file(size)
    if until is not None:
        end = min(end, (time.monotonic() + until) / 2)
    with _opened(place, chosen, end) as visit:
        visit.check_headers(size)
        with atomic_write(target) as stream:
            digest = hashlib.sha256()
            for chunk in visit.chunks(size):
                digest.update(chunk)
                stream.write(chunk)
            if digest.hexdigest() != sha256:
                raise _other(place, f"SHA-256 {digest.hexdigest()}", sha256)
    return target


def _other(place: WebAddress, found: str, stated: str) -> SubmissionError:
    return SubmissionError(
        f"the file there has {found}",
        where=place.url,
        expected=f"{stated}, as submission.toml states",
        fix="state what the file has, or put back the file that was meant",
    )


class _Visit:
    """A connection to one address of a host, and its answer."""

    def __init__(self, place: WebAddress, address: str, network: Network, end: float) -> None:
        self.place = place
        self._patience, self._end = network.patience, end
        silence = min(network.patience.silence, _left(place, end))
        plain = network.connect(address, silence)
        plain.settimeout(silence)
        self._socket = network.trust.wrap_socket(
            plain, server_hostname=place.host, do_handshake_on_connect=False
        )
        self._late = False

    def ask(self) -> None:
        with self._watched(min(self._patience.answer, _left(self.place, self._end))):
            self._socket.do_handshake()
            connection = http.client.HTTPConnection(self.place.host, HTTPS_PORT)
            connection.sock = self._socket
            connection.putrequest("GET", self.place.target, skip_host=True)
            connection.putheader("Host", self.place.host)
            connection.putheader("User-Agent", f"airzoo-bench/{__version__}")
            connection.putheader("Connection", "close")
            connection.endheaders()
            self.response = connection.getresponse()

    def close(self) -> None:
        self._socket.close()
        if hasattr(self, "response"):
            self.response.close()

    def check_headers(self, size: int) -> None:
        """Refuse what is already wrong before the first byte of the file."""
        answer = self.response
        if answer.status != http.client.OK:
            reason = shown(answer.reason.replace(" ", "_")).replace("_", " ")
            raise SubmissionError(
                f"the host answers {answer.status} {reason}",
                where=self.place.url,
                fix="see that anybody can open the address without logging in",
            )
        coding = answer.getheader("Content-Encoding", "identity").strip().lower()
        if coding != "identity":
            raise SubmissionError(
                f"the host compresses the answer ({shown(coding)}), though it was not asked to",
                where=self.place.url,
                fix="put the file on a host that serves it as it is",
            )
        length = answer.getheader("Content-Length")
        if length is not None and length.strip() != str(size):
            raise _other(self.place, f"{shown(length)} bytes", f"{size} bytes")

    def chunks(self, size: int) -> Iterator[bytes]:
        """Yield the file, and refuse it at the first byte too many."""
        seen = 0
        with self._watched(_left(self.place, self._end)):
            while chunk := self.response.read1(_CHUNK_BYTES):
                seen += len(chunk)
                if seen > size:
                    raise _other(self.place, f"more than {size} bytes", f"{size} bytes")
                yield chunk
        if seen < size:
            raise _other(self.place, f"ended after {counted(seen, 'byte')}", f"{size} bytes")

    @contextmanager
    def _watched(self, seconds: float) -> Iterator[None]:
        # A host that sends a byte now and then never lets a read time out.
        watchdog = threading.Timer(seconds, self._cut)
        watchdog.daemon = True
        watchdog.start()
        try:
            yield
        except (OSError, http.client.HTTPException) as error:
            if self._late or isinstance(error, TimeoutError):
                raise _too_slow(self.place, seconds) from None
            raise
        finally:
            watchdog.cancel()
        if self._late:
            raise _too_slow(self.place, seconds)

    def _cut(self) -> None:
        self._late = True
        try:
            # Not SSLSocket's own, which would change what the reading thread uses.
            socket.socket.shutdown(self._socket, socket.SHUT_RDWR)
        except OSError:  # it is closed already
            return


def _left(place: WebAddress, end: float) -> float:
    """Return the seconds until the end of a fetch, of which there must be some."""
    seconds = end - time.monotonic()
    if seconds <= 0:
        raise _too_slow(place, 0)
    return seconds


def _too_slow(place: WebAddress, seconds: float) -> SubmissionError:
    return SubmissionError(
        "the host is too slow",
        where=place.url,
        expected=f"an end within {seconds:,.0f} s, and no long silence",
        fix="try again later, or put the file on a faster host",
    )


@contextmanager
def _opened(place: WebAddress, network: Network, end: float) -> Iterator[_Visit]:
    """Ask for a file, wherever it has moved to."""
    known: dict[str, list[str]] = {}
    for _ in range(_REDIRECTS + 1):
        if place.host not in known:
            known[place.host] = public_addresses(place.host, network.resolve)
        visit = _visited(place, known[place.host], network, end)
        try:
            location = visit.response.getheader("Location")
            if visit.response.status not in _MOVED or location is None:
                with _told(place):
                    yield visit
                return
        finally:
            visit.close()
        place = place.redirected(location)
    raise SubmissionError(f"the address leads on more than {_REDIRECTS} times", where=place.url)


def _visited(place: WebAddress, addresses: Sequence[str], network: Network, end: float) -> _Visit:
    """Ask the first address of a host that takes a connection."""
    failed: OSError = OSError("no address")
    for address in addresses[:_MOST_ADDRESSES]:
        try:
            visit = _Visit(place, address, network, end)
        except OSError as error:
            failed = error
            continue
        try:
            with _told(place):
                visit.ask()
        except BaseException:
            visit.close()
            raise
        return visit
    raise SubmissionError(f"the host cannot be reached ({failed})", where=place.url)


@contextmanager
def _told(place: WebAddress) -> Iterator[None]:
    try:
        yield
    except (OSError, http.client.HTTPException) as error:
        raise SubmissionError(
            f"the host breaks off ({type(error).__name__}: {shown(str(error))})",
            where=place.url,
            fix="open the address in a browser; its certificate must be valid for the host",
        ) from None
