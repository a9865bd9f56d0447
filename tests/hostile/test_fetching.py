"""Predictions by address, against a real https server and the tricks that hosts have played."""

from __future__ import annotations

import hashlib
import shutil
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.fetching import fetch

pytestmark = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="no openssl: apt install openssl"
)
HOST, OTHER, PUBLIC = "data.example.org", "cdn.example.net", "93.184.215.14"
PATH = "/files/preds.npz"
CONTENT = b"predictions" * 30_000
SHA256 = hashlib.sha256(CONTENT).hexdigest()
STATED: Any = {"size": len(CONTENT), "sha256": SHA256, "seconds": 60.0}


def answer(content: bytes, *lines: str, status: str = "200 OK") -> list[bytes]:
    """Return what a host sends; of two lengths the first one counts, which may be in `lines`."""
    head = (f"HTTP/1.1 {status}", *lines, f"Content-Length: {len(content)}", "", "")
    return ["\r\n".join(head).encode() + content]


def redirect(location: str) -> list[bytes]:
    return answer(b"", f"Location: {location}", status="302 Found")


@pytest.fixture
def web(tmp_path_factory: Any, monkeypatch: Any) -> SimpleNamespace:
    """Serve as every host, by path, with a certificate that is its own authority."""
    made = SimpleNamespace(answers={}, addresses={}, requests=[])
    file = str(tmp_path_factory.mktemp("web") / "certificate.pem")
    call = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj /CN=tests"
    call += f" -addext subjectAltName=DNS:{HOST},DNS:{OTHER}"
    subprocess.run([*call.split(), "-keyout", file, "-out", file], check=True, capture_output=True)
    (context := ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)).load_cert_chain(file)

    def serve(plain: socket.socket) -> None:
        with suppress(OSError), context.wrap_socket(plain, server_side=True) as peer:
            made.requests.append(asked := peer.recv(1 << 16).decode())
            for part in made.answers.get(asked.split()[1], answer(b"")):
                peer.sendall(part)

    def resolve(host: str, *_: Any, **__: Any) -> list[Any]:
        return [(0, 0, 0, "", (one, 443)) for one in made.addresses.get(host, [PUBLIC])]

    def reach(place: object, _: float) -> socket.socket:
        assert place == (PUBLIC, 443)  # which was checked, and no name that is looked up again
        near, far = socket.socketpair()
        threading.Thread(target=serve, args=[far], daemon=True).start()
        return near

    monkeypatch.setenv("SSL_CERT_FILE", file)
    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    monkeypatch.setattr(socket, "create_connection", reach)
    return made


def refusal(into: Path, url: str = f"https://{HOST}{PATH}", **changes: Any) -> str:
    """Fetch what must not arrive; nothing of it may be left on disk."""
    with pytest.raises(SubmissionError) as caught:
        fetch(url, into, **(STATED | changes))
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


def test_a_file_arrives_under_its_name_once(web: SimpleNamespace, tmp_path: Path) -> None:
    web.answers = dict.fromkeys([*NAMES, SIGNED], answer(CONTENT))
    web.answers[PATH] = redirect(f"https://{OTHER}{SIGNED}")
    for number, (path, name) in enumerate(NAMES.items()):
        for _ in range(2):
            found = fetch(f"https://{HOST}{path}", tmp_path / str(number), **STATED)
            assert (found, found.read_bytes()) == (tmp_path / str(number) / name, CONTENT)
    hosts = [request.split("\r\n")[1] for request in web.requests]
    assert hosts == [f"Host: {HOST}"] * len(NAMES) + [f"Host: {OTHER}"]


def drip() -> Iterator[bytes]:
    while True:
        time.sleep(0.02)
        yield b"X"


def test_other_answers_are_refused(web: Any, tmp_path: Path, monkeypatch: Any) -> None:
    refused: list[tuple[Iterable[bytes], str]] = [  # the last three have no end
        (answer(CONTENT + b"x"), f"more than {len(CONTENT)} bytes"),
        (answer(CONTENT[:-1]), f"{len(CONTENT) - 1} bytes"),
        (answer(CONTENT[::-1]), hashlib.sha256(CONTENT[::-1]).hexdigest()),
        (answer(b"x", "Content-Length: 9"), "breaks off"),
        ([b"no HTTP at all\r\n\r\n"], f"https://{HOST}{PATH}"),
        (answer(b"", status="206 No"), "answers 206"),
        (answer(b"", status="500 \x1b[31mred"), "answers 500"),
        (redirect(PATH), "leads on more than 5 times"),
        (chain([b"HTTP/1.1 200 OK\r\n\r\n"], repeat(bytes(1 << 16))), "more than"),
        (chain([b"HTTP/1.1 200 OK\r\n"], drip()), "too slow"),
        (chain(answer(b"", "Content-Length: 330000"), drip()), "too slow"),
    ]
    for web.answers[PATH], said in refused:
        assert said in refusal(tmp_path, seconds=0.3 if said == "too slow" else 60.0)
    assert len(web.requests) == len(refused) + 5
    monkeypatch.delenv("SSL_CERT_FILE")
    assert "certificate" in refusal(tmp_path)


ADDRESSES = [
    *("http://data.example.org/a.npz", "file:///etc/passwd", "https://localhost/a.npz"),
    *("https://data.example.org@127.0.0.1/a.npz", "https://data.example.org:8443/a.npz"),
    *("https://127.0.0.1/a.npz", "https://2130706433/a.npz", "https://0x7f.0.0.1/a.npz"),
    "https://[::ffff:127.0.0.1]/a.npz",
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


def test_addresses_that_are_not_public_are_never_asked(web: Any, tmp_path: Path) -> None:
    for url in ADDRESSES:
        assert "expected: https://HOST/PATH" in refusal(tmp_path, url)
    assert not web.requests
    for url in ADDRESSES[:9]:
        web.answers[PATH] = redirect(url)
        assert "expected: https://HOST/PATH" in refusal(tmp_path)
    web.answers[PATH] = redirect(f"https://{OTHER}/x")
    for address in PRIVATE:
        web.addresses = {OTHER: [PUBLIC, address]}
        assert "is not public" in refusal(tmp_path, f"https://{OTHER}/x"), address
        assert "is not public" in refusal(tmp_path), address
    # Only those that lead there were asked.
    assert len(web.requests) == 9 + len(PRIVATE)
