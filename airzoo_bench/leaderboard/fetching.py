"""Predictions by address: over https from public hosts, bounded in bytes and time, hashed."""

from __future__ import annotations

import hashlib
import ipaddress
import re
import socket
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryFile
from typing import IO, NamedTuple
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.core.version import __version__

__all__ = ["Network", "fetch", "parse_address"]

_CHUNK_BYTES = 1 << 16
_TIMED_OUT = 28  # as curl exits
_REDIRECTS = 5
_MOVED = ("301", "302", "303", "307", "308")
_LONGEST_URL = 8000  # signed addresses of redirects are long
_SLOWEST_BYTES_S = 250_000
_LONGEST_S = 3600.0
_ANSWER_S = 60.0
_LABEL = r"[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?"
# The last label begins with a letter, so no number in any base is taken for a name.
_HOST = re.compile(rf"(?=.{{4,253}}\Z)(?:{_LABEL}\.)+[a-z](?:[a-z0-9-]{{0,61}}[a-z0-9])\Z")
_UNICAST = ipaddress.ip_network("2000::/3")
# The address of the machine behind these is not the one that is seen.
_TUNNELS = tuple(map(ipaddress.ip_network, ("2002::/16", "2001::/32", "192.88.99.0/24")))


def _system_addresses(host: str) -> list[str]:
    found = socket.getaddrinfo(host, 443, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(address[0]) for *_, address in found))


@dataclass(frozen=True)
class Network:
    """How hosts are found and reached.

    Attributes
    ----------
    resolve : callable
        From a host to its addresses.
    options : sequence of str
        Further options of curl.
    """

    resolve: Callable[[str], Sequence[str]] = _system_addresses
    options: Sequence[str] = field(default=())


def fetch(
    url: str,
    into: Path,
    *,
    size: int,
    sha256: str,
    seconds: float | None = None,
    network: Network = Network(),
) -> Path:
    """Fetch a file of stated size and content into a folder, within some seconds."""
    address = parse_address(url)
    target = into / _file_name(address)
    if target.is_file() and target.stat().st_size == size and sha256_of(target) == sha256:
        return target
    allowed = min(_ANSWER_S + size / _SLOWEST_BYTES_S, _LONGEST_S if seconds is None else seconds)
    end = time.monotonic() + allowed
    with atomic_write(target) as stream:
        for _ in range(_REDIRECTS + 1):
            moved = _visit(address, stream, size, sha256, end, network)
            if moved is None:
                return target
            address = parse_address(urljoin(address.geturl(), moved))
        raise SubmissionError(f"the address leads on more than {_REDIRECTS} times", where=url)


def parse_address(url: str) -> SplitResult:
    """Take an https address apart whose host is a plain name."""
    fault = ""
    if len(url) > _LONGEST_URL or not re.fullmatch(r"[!-~]+", url) or "\\" in url:
        fault = "an address that is too long, or has blanks, backslashes or letters beyond ASCII"
    else:
        fault = _fault_of_parts(urlsplit(url))
    if fault:
        raise SubmissionError(
            fault,
            where=_plain(url),
            expected="https://HOST/PATH, where HOST is a name such as example.org",
            fix="put the predictions where such an address leads to them",
        )
    return urlsplit(url)


def _fault_of_parts(parts: SplitResult) -> str:
    if parts.scheme != "https":
        return "the address is not https"
    if "@" in parts.netloc:
        return "the address has a user name"
    host, _, port = parts.netloc.lower().partition(":")
    if ":" in parts.netloc and port != "443":
        return "the address names a port other than 443, or the host is a number"
    if not _HOST.match(host) or any(label.startswith("xn--") for label in host.split(".")):
        return "the host is no plain name with a dot: numbers and foreign alphabets are not taken"
    return ""


def _file_name(address: SplitResult) -> str:
    """Return the last part of the path that is a plain name with a suffix."""
    parts = unquote(address.path).split("/")
    named = (part for part in reversed(parts) if "." in part and re.match(SAFE_NAME, part))
    return next(named, "predictions")


def _visit(
    address: SplitResult,
    stream: IO[bytes],
    size: int,
    sha256: str,
    end: float,
    network: Network,
) -> str | None:
    """Write the file at an address to a stream, or return the address that it has moved to."""
    public = _public_address(str(address.hostname), network.resolve)
    answer = _run_curl(address, public, stream, size, end - time.monotonic(), network.options)
    if answer.status in _MOVED and answer.location:
        stream.seek(0)
        stream.truncate()
        return answer.location
    if answer.status != "200":
        raise SubmissionError(
            f"the host answers {_plain(answer.status)}",
            where=address.geturl(),
            fix="see that anybody can open the address without logging in",
        )
    if answer.size != size:
        raise _other(address, f"{answer.size} bytes", f"{size} bytes")
    if answer.sha256 != sha256:
        raise _other(address, f"SHA-256 {answer.sha256}", sha256)
    return None


class _Answer(NamedTuple):
    status: str
    location: str
    size: int
    sha256: str


def _run_curl(
    address: SplitResult,
    public: str,
    stream: IO[bytes],
    most: int,
    seconds: float,
    options: Sequence[str],
) -> _Answer:
    """Ask one address of a host for a file, and write at most so many bytes of it."""
    if seconds <= 1:
        raise _too_slow(address)
    at = f"[{public}]" if ":" in public else public
    digest, seen = hashlib.sha256(), 0
    with NamedTemporaryFile("r", encoding="latin-1") as head, TemporaryFile() as said:
        command = (
            *("curl", "--disable", "--silent", "--show-error", "--globoff", "--proto", "=https"),
            *("--noproxy", "*", "--max-time", f"{seconds:.0f}", "--connect-timeout", "30"),
            *("--speed-time", "60", "--speed-limit", "1000", "--dump-header", head.name),
            *("--user-agent", f"airzoo-bench/{__version__}"),
            *("--resolve", f"{address.hostname}:443:{at}", *options, "--", address.geturl()),
        )
        try:
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said)
        except FileNotFoundError as error:
            raise SubmissionError("curl is not installed", fix="install curl") from error
        with process:
            assert process.stdout is not None
            while chunk := process.stdout.read(_CHUNK_BYTES):
                seen += len(chunk)
                if seen > most:
                    process.kill()
                    raise _other(address, f"more than {most} bytes", f"{most} bytes")
                digest.update(chunk)
                stream.write(chunk)
        said.seek(0)
        why = said.read(500).decode("utf-8", "replace").strip()
        status, location = _headers(head.read(1 << 16))
    if process.returncode == _TIMED_OUT:
        raise _too_slow(address)
    if process.returncode:
        raise SubmissionError(
            f"the host breaks off or cannot be reached ({_plain(why, blanks=True)})",
            where=address.geturl(),
            fix="open the address in a browser; its certificate must be valid for the host",
        )
    return _Answer(status, location, seen, digest.hexdigest())


def _headers(text: str) -> tuple[str, str]:
    """Return the status and the location of the last answer."""
    lines = text.replace("\r", "").split("\n")
    status = [line.split(" ")[1] for line in lines if re.match(r"HTTP/[\d.]+ \d{3}", line)]
    named = (line.partition(":") for line in lines)
    location = [value.strip() for name, _, value in named if name.lower() == "location"]
    return (status or [""])[-1], (location or [""])[-1]


def _public_address(host: str, resolve: Callable[[str], Sequence[str]]) -> str:
    """Return the first address of a host; all must be public."""
    try:
        found = list(resolve(host))
    except (OSError, UnicodeError) as error:
        raise SubmissionError(f"the host cannot be found ({error})", where=host) from None
    private = [address for address in found if not _is_public(address)]
    if private or not found:
        raise SubmissionError(
            f"the host's address {_plain(private[0])} is not public" if private else "no address",
            where=host,
            expected="addresses that the whole internet reaches",
            fix="put the predictions on a public host",
        )
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


def _other(address: SplitResult, found: str, stated: str) -> SubmissionError:
    return SubmissionError(
        f"the file there has {found}",
        where=address.geturl(),
        expected=f"{stated}, as submission.toml states",
        fix="state what the file has, or put back the file that was meant",
    )


def _too_slow(address: SplitResult) -> SubmissionError:
    return SubmissionError(
        "the host is too slow",
        where=address.geturl(),
        expected=f"at least {_SLOWEST_BYTES_S:,} bytes a second, and an end within an hour",
        fix="try again later, or put the file on a faster host",
    )


def _plain(text: str, *, blanks: bool = False) -> str:
    """Return text of a stranger's machine, cut and without characters that a terminal obeys."""
    plain = "".join(c if "!" <= c <= "~" or (blanks and c == " ") else "?" for c in text[:200])
    return plain + "..." * (len(text) > 200)
