"""Which addresses predictions may be fetched from: https, a plain host name, public hosts only."""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import SAFE_NAME

__all__ = ["HTTPS_PORT", "WebAddress", "public_addresses", "shown", "system_resolver"]

HTTPS_PORT = 443
_LONGEST_URL = 8000  # signed addresses that hosts lead on to are long
_SHOWN = 200
_LABEL = r"[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?"
# The last label begins with a letter, so no number in any base is taken for a name.
_HOST = re.compile(rf"(?=.{{4,253}}\Z)(?:{_LABEL}\.)+[a-z](?:[a-z0-9-]{{0,61}}[a-z0-9])\Z")
_UNICAST = ipaddress.ip_network("2000::/3")
# Of these, the address of the machine that is reached is not the one that is seen.
_TUNNELS = tuple(map(ipaddress.ip_network, ("2002::/16", "2001::/32", "192.88.99.0/24")))


def shown(text: str) -> str:
    """Return what a stranger's machine sent, cut and without what a terminal would obey."""
    plain = "".join(c if "!" <= c <= "~" else "\N{REPLACEMENT CHARACTER}" for c in text[:_SHOWN])
    return plain + ("..." if len(text) > _SHOWN else "")


@dataclass(frozen=True)
class WebAddress:
    """An https address whose host is a plain name.

    Attributes
    ----------
    host : str
        In lower case.
    target : str
        Path and query, as the request line has them.
    """

    host: str
    target: str

    @classmethod
    def parse(cls, url: str) -> WebAddress:
        """Take an address apart."""
        fault = _fault_of_text(url)
        if fault is None:
            parts = urlsplit(url)
            fault = _fault_of_parts(parts)
        if fault is not None:
            raise SubmissionError(
                fault,
                where=shown(url),
                expected="https://HOST/PATH, where HOST is a name such as example.org",
                fix="put the predictions where such an address leads to them",
            )
        target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        return cls(str(parts.hostname), target)

    @property
    def url(self) -> str:
        """The whole address."""
        return f"https://{self.host}{self.target}"

    @property
    def file_name(self) -> str:
        """The last part of the path that is a plain name with a suffix."""
        parts = unquote(self.target.partition("?")[0]).split("/")
        named = (part for part in reversed(parts) if "." in part and re.match(SAFE_NAME, part))
        return next(named, "predictions")

    def redirected(self, location: str) -> WebAddress:
        """Return where a host sends the reader: an address that `parse` takes."""
        return WebAddress.parse(urljoin(self.url, location))


def _fault_of_text(url: str) -> str | None:
    if len(url) > _LONGEST_URL:
        return f"an address of {len(url):,} characters"
    if not re.fullmatch(r"[!-~]+", url) or "\\" in url:
        return "the address has blanks, control characters, backslashes or letters beyond ASCII"
    return None


def _fault_of_parts(parts: SplitResult) -> str | None:
    if parts.scheme != "https":
        return "the address is not https"
    if "@" in parts.netloc:
        return "the address has a user name"
    name, _, port = parts.netloc.partition(":")
    if ":" in parts.netloc and port != str(HTTPS_PORT):
        return f"the address names a port other than {HTTPS_PORT}, or the host is a number"
    host = name.lower()
    if not _HOST.match(host) or any(label.startswith("xn--") for label in host.split(".")):
        return (
            "the host is no plain name with a dot: numbers, foreign alphabets and a dot at the"
            " end are not taken"
        )
    return None


def system_resolver(host: str) -> list[str]:
    """Ask the system for the addresses of a host, in its order."""
    found = socket.getaddrinfo(host, HTTPS_PORT, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(address[0]) for *_, address in found))


def public_addresses(host: str, resolve: Callable[[str], Sequence[str]]) -> list[str]:
    """Return the addresses of a host, each of which all of the internet reaches alike."""
    try:
        found = list(resolve(host))
    except (OSError, UnicodeError) as error:
        raise SubmissionError(f"the host cannot be found ({error})", where=host) from None
    if not found:
        raise SubmissionError("the host has no address", where=host)
    for address in found:
        if not _is_public(address):
            raise SubmissionError(
                f"the host's address {shown(address)} is not public",
                where=host,
                expected="addresses that the whole internet reaches",
                fix="put the predictions on a public host",
            )
    return found


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
