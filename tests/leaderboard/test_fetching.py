"""Predictions by address, against a real https server and the tricks that hosts have played."""

from __future__ import annotations

import gzip
import hashlib
import re
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer
from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard import fetching

HOST, OTHER, PUBLIC = "data.example.org", "cdn.example.net", "93.184.215.14"
PATH = "/files/preds.npz"
URL = f"https://{HOST}{PATH}"
CONTENT = b"predictions" * 30_000


def answer(content: bytes, *lines: str, status: str = "200 OK", size: str = "") -> list[bytes]:
    """Return what a host sends, honestly unless another size is stated."""
    head = (f"HTTP/1.1 {status}", f"Content-Length: {size or len(content)}", *lines, "", "")
    return ["\r\n".join(head).encode() + content]


def redirect(location: str) -> list[bytes]:
    return answer(b"", f"Location: {location}", status="302 Found")


def drip(begin: bytes, more: bytes, wait: float, sent: list[int]) -> Iterator[bytes]:
    """Yield an answer without an end."""
    yield begin
    while True:
        time.sleep(wait)
        yield more
        sent.append(len(more))


class Web(ThreadingTCPServer):
    """Every host of the network, which answers by path; names lead to `addresses`."""

    daemon_threads = True

    def __init__(self, certificate: Path) -> None:
        super().__init__(("127.0.0.1", 0), BaseRequestHandler)
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.load_cert_chain(certificate)
        self.answers: dict[str, Iterable[bytes]] = {}
        self.addresses: dict[str, list[str]] = {}
        self.requests: list[bytes] = []

    def finish_request(self, request: Any, client_address: Any) -> None:
        with suppress(OSError), self.context.wrap_socket(request, server_side=True) as peer:
            self.requests.append(asked := peer.recv(1 << 16))
            for part in self.answers.get(asked.split(b" ")[1].decode(), answer(b"")):
                peer.sendall(part)

    def resolve(self, host: str, *_: Any, **__: Any) -> list[Any]:
        return [(0, 0, 0, "", (one, 443)) for one in self.addresses.get(host, [PUBLIC])]

    def reach(self, _: object, wait: float) -> socket.socket:
        peer = socket.socket()
        peer.settimeout(wait)
        peer.connect(self.server_address)
        return peer


@pytest.fixture
def web(tmp_path_factory: Any, monkeypatch: Any) -> Iterator[Web]:
    """Serve with a self-signed certificate for the hosts, which is its own authority."""
    file = str(tmp_path_factory.mktemp("web") / "certificate.pem")
    call = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj /CN=tests"
    call += f" -addext subjectAltName=DNS:{HOST},DNS:{OTHER}"
    subprocess.run([*call.split(), "-keyout", file, "-out", file], check=True, capture_output=True)
    monkeypatch.setenv("SSL_CERT_FILE", file)
    with Web(Path(file)) as made:
        monkeypatch.setattr(fetching.socket, "getaddrinfo", made.resolve)
        monkeypatch.setattr(fetching.socket, "create_connection", made.reach)
        threading.Thread(target=made.serve_forever, args=[0.01], daemon=True).start()
        yield made
        made.shutdown()


STATED: Any = {"size": len(CONTENT), "sha256": hashlib.sha256(CONTENT).hexdigest(), "seconds": 60.0}


def refusal(into: Path, url: str = URL, **changes: Any) -> str:
    """Fetch what must not arrive; nothing of it may be left on disk."""
    with pytest.raises(SubmissionError) as caught:
        fetching.fetch(url, into, **(STATED | changes))
    assert not into.exists() or not list(into.iterdir())
    assert not {"\x1b", "\r"} & {*str(caught.value)}
    return str(caught.value)


SIGNED = "/signed" + "a" * 2500 + "?Expires=5"  # as of Hugging Face and of GitHub's releases
NAMES = {
    "/a/preds.npz?download=1": "preds.npz",
    "/api/records/7/files/salad.zip/content": "salad.zip",
    "/a/..%2f..%2fetc.passwd": "etc.passwd",
    "/a/.ssh": "predictions",
    PATH: "preds.npz",
}


def test_a_file_arrives_under_its_name_once(web: Web, tmp_path: Path) -> None:
    web.answers = {path: answer(CONTENT) for path in (*NAMES, SIGNED)}
    web.answers[PATH] = redirect(f"https://{OTHER}{SIGNED}")
    for number, (path, name) in enumerate(NAMES.items()):
        for _ in range(2):
            found = fetching.fetch(f"https://{HOST}{path}", tmp_path / str(number), **STATED)
            assert (found, found.read_bytes()) == (tmp_path / str(number) / name, CONTENT)
    hosts = [re.findall(rb"\r\nHost: (.*)\r\n", request) for request in web.requests]
    assert hosts == [[HOST.encode()]] * len(NAMES) + [[OTHER.encode()]]


REFUSED: list[tuple[Iterable[bytes], str]] = [
    (answer(CONTENT + b"x"), f"more than {len(CONTENT)} bytes"),
    (answer(CONTENT[:-1]), f"{len(CONTENT) - 1} bytes"),
    (answer(CONTENT[::-1]), hashlib.sha256(CONTENT[::-1]).hexdigest()),
    (answer(gzip.compress(bytes(len(CONTENT))), "Content-Encoding: gzip"), "bytes"),
    (answer(b"x", size="9"), "breaks off"),
    ([b"no HTTP at all\r\n\r\n"], URL),
    (answer(b"", status="206 No"), "answers 206"),
    (answer(b"", status="500 \x1b[31mred"), "answers 500"),
    (redirect(PATH), "leads on more than 5 times"),
]


def test_other_answers_are_refused(web: Web, tmp_path: Path, monkeypatch: Any) -> None:
    for web.answers[PATH], said in REFUSED:
        assert said in refusal(tmp_path)
    assert len(web.requests) == len(REFUSED) + 5
    monkeypatch.delenv("SSL_CERT_FILE")
    assert "certificate" in refusal(tmp_path)


def test_an_endless_body_is_cut_and_a_host_that_drips_is_left(web: Web, tmp_path: Path) -> None:
    begun, whole = b"HTTP/1.1 200 OK\r\n", answer(b"", size="330000")[0]
    web.answers[PATH] = drip(begun + b"\r\n", bytes(1 << 16), 0.0, sent := [])
    assert "more than" in refusal(tmp_path, size=1 << 20)
    time.sleep(0.1)
    assert sum(sent) < 64 << 20  # as much as buffers hold, not as much as could be sent
    for begin in (begun, whole):
        web.answers[PATH] = drip(begin, b"X", 0.02, [])
        assert "too slow" in refusal(tmp_path, seconds=0.3)


ADDRESSES = [
    *("http://data.example.org/a.npz", "file:///etc/passwd", "https://localhost/a.npz"),
    *("https://user@data.example.org/a.npz", "https://data.example.org@127.0.0.1/a.npz"),
    *("https://data.example.org:8443/a.npz", "https://[::ffff:127.0.0.1]/a.npz"),
    *("https://127.0.0.1/a.npz", "https://2130706433/a.npz", "https://0x7f.0.0.1/a.npz"),
    # Not in headers: a Cyrillic letter, and what ends a line or a header.
    *("https://dаta.example.org/a.npz", "https://xn--dta-7cd.example.org/a.npz", ""),
    *("https://data.example.org/a\r\nHost: other.org", "https://data.example.org\\@127.0.0.1/a"),
    "https://data.example.org/" + "a" * 9000,
]
PRIVATE = [
    *("127.0.0.1", "0.0.0.0", "10.1.2.3", "172.16.0.1", "192.168.1.1", "100.64.0.1"),
    *("169.254.169.254", "192.0.2.1", "198.18.0.1", "224.0.0.1", "240.0.0.1", "::", "::1"),
    *("::ffff:127.0.0.1", "fe80::1%eth0", "fd00:ec2::254", "ff02::1", "2001:db8::1"),
    *("2002:7f00:1::", "64:ff9b::7f00:1"),
]


def test_addresses_that_are_not_public_are_never_asked(web: Web, tmp_path: Path) -> None:
    for url in ADDRESSES:
        assert "expected: https://HOST/PATH" in refusal(tmp_path, url)
    assert not web.requests
    for url in ADDRESSES[:10]:
        web.answers[PATH] = redirect(url)
        assert "expected: https://HOST/PATH" in refusal(tmp_path)
    web.answers[PATH] = redirect(f"https://{OTHER}/x")
    for address in PRIVATE:
        web.addresses = {OTHER: [PUBLIC, address]}
        assert "is not public" in refusal(tmp_path, f"https://{OTHER}/x"), address
        assert "is not public" in refusal(tmp_path), address
    # Only those that lead there were asked.
    assert len(web.requests) == 10 + len(PRIVATE)
