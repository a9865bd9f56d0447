"""Predictions by address, against a real https server and the tricks that hosts have played."""

from __future__ import annotations

import gzip
import itertools
import socket
import time
from contextlib import suppress
from pathlib import Path

import pytest

from airzoo_bench.leaderboard.fetching import fetch
from tests.leaderboard.web_server import (
    CONTENT,
    HOST,
    OTHER,
    PUBLIC,
    URL,
    WebServer,
    head,
    plain,
    redirect,
    refusal,
    sha256,
)


def arrived(web: WebServer, into: Path, url: str = URL, **changes: object) -> Path:
    settings = {"size": len(CONTENT), "sha256": sha256(CONTENT), "network": web.network()}
    return fetch(url, into, **(settings | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("/a/preds.npz?download=1", "preds.npz"),
        ("/api/records/7/files/salad.zip/content", "salad.zip"),
        ("/a/..%2f..%2fetc.passwd", "etc.passwd"),
        ("/a/.ssh", "predictions"),
    ],
)
def test_a_file_arrives_under_its_name(
    web: WebServer, tmp_path: Path, path: str, name: str
) -> None:
    web.answers[path] = plain(CONTENT)
    found = arrived(web, tmp_path, f"https://{HOST}{path}")
    assert (found, found.read_bytes()) == (tmp_path / name, CONTENT)
    assert b"\r\nHost: data.example.org\r\n" in web.requests[0]


class TestContent:
    def test_an_endless_body_is_cut(self, web: WebServer, tmp_path: Path) -> None:
        sent = itertools.count()

        def endless(_: str, peer: socket.socket) -> None:
            peer.sendall(head())
            with suppress(OSError):
                while True:
                    peer.sendall(bytes(1 << 16))
                    next(sent)

        web.answers["/files/preds.npz"] = endless
        assert "more than" in refusal(web, tmp_path, size=1 << 20)
        time.sleep(0.1)
        assert next(sent) < 1000  # 64 MB: as much as buffers hold, not as much as could be sent

    @pytest.mark.parametrize(
        ("answer", "said"),
        [
            (plain(CONTENT + b"x"), f"more than {len(CONTENT)} bytes"),
            (plain(CONTENT[:-1]), f"{len(CONTENT) - 1} bytes"),
            (plain(CONTENT[::-1]), sha256(CONTENT[::-1])),
            (plain(gzip.compress(bytes(len(CONTENT))), "Content-Encoding: gzip"), "bytes"),
            (lambda _, p: p.sendall(head("Content-Length: 9") + b"x"), "breaks off"),
            (lambda _, p: p.sendall(head("Content-Length: 0", status="404 No")), "answers 404"),
            (lambda _, p: p.sendall(head("Content-Length: 0", status="206 No")), "answers 206"),
            (lambda _, p: p.sendall(b"no HTTP at all\r\n\r\n"), URL),
            (lambda _, p: p.sendall(head(status="500 \x1b[31mred")), "answers 500"),
        ],
    )
    def test_another_answer_is_refused(
        self, web: WebServer, tmp_path: Path, answer: object, said: str
    ) -> None:
        web.answers["/files/preds.npz"] = answer  # type: ignore[assignment]
        message = refusal(web, tmp_path)
        assert said in message
        assert "\x1b" not in message

    def test_a_certificate_of_nobody_is_refused(self, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = plain(CONTENT)
        assert "certificate" in refusal(web, tmp_path, network=web.network(trusted=False))


@pytest.mark.parametrize(
    ("begin", "drop"),
    [
        (b"HTTP/1.1 200 OK\r\n", b"X"),
        (head(f"Content-Length: {len(CONTENT)}"), b"p"),
    ],
)
def test_a_host_that_drips_is_left(
    begin: bytes, drop: bytes, web: WebServer, tmp_path: Path
) -> None:
    def answer(_: str, peer: socket.socket) -> None:
        with suppress(OSError):
            peer.sendall(begin)
            while True:
                time.sleep(0.02)
                peer.sendall(drop)

    web.answers["/files/preds.npz"] = answer
    assert "too slow" in refusal(web, tmp_path, seconds=2.0)


@pytest.mark.parametrize(
    "url",
    [
        "http://data.example.org/a.npz",
        "file:///etc/passwd",
        "https:///a.npz",
        "https://user@data.example.org/a.npz",
        "https://data.example.org@127.0.0.1/a.npz",
        "https://data.example.org:8443/a.npz",
        "https://data.example.org./a.npz",
        "https://localhost/a.npz",
        "https://127.0.0.1/a.npz",
        "https://2130706433/a.npz",
        "https://0x7f.0.0.1/a.npz",
        "https://127.1/a.npz",
        "https://[::ffff:127.0.0.1]/a.npz",
        "https://dаta.example.org/a.npz",  # a Cyrillic letter
        "https://xn--dta-7cd.example.org/a.npz",
        "https://data.example.org/a\r\nHost: other.org",
        "https://data.example.org\\@127.0.0.1/a.npz",
        "https://data_x.example.org/a.npz",
        "https://data.example.org/" + "a" * 9000,
        "-Kfile",
        "",
    ],
)
def test_other_addresses_are_refused_before_any_look_up(
    url: str, web: WebServer, tmp_path: Path
) -> None:
    def nobody(host: str) -> list[str]:
        raise AssertionError("a refused address must not be looked up")

    message = refusal(web, tmp_path, url, network=web.network(nobody))
    assert "expected: https://HOST/PATH" in message
    assert "\r" not in message
    with_redirect = redirect(url.replace("\r\n", ""))
    if url.startswith(("https://", "http:", "file")) and url.isascii() and "///a" not in url:
        web.answers["/files/preds.npz"] = with_redirect
        refusal(web, tmp_path)
        assert len(web.requests) == 1


@pytest.mark.parametrize(
    "address",
    [
        *("127.0.0.1", "0.0.0.0", "10.1.2.3", "172.16.0.1", "192.168.1.1", "100.64.0.1"),
        *("169.254.169.254", "192.0.2.1", "198.18.0.1", "224.0.0.1", "240.0.0.1", "::", "::1"),
        *("::ffff:127.0.0.1", "fe80::1%eth0", "fd00:ec2::254", "ff02::1", "2001:db8::1"),
        *("2002:7f00:1::", "64:ff9b::7f00:1", "not an address"),
    ],
)
def test_addresses_that_are_not_public(address: str, web: WebServer, tmp_path: Path) -> None:
    network = web.network(lambda host: [PUBLIC, address])
    assert "is not public" in refusal(web, tmp_path, network=network)
    assert web.requests == []
    web.answers["/files/preds.npz"] = redirect(f"https://{OTHER}/x")
    network = web.network({HOST: [PUBLIC], OTHER: [PUBLIC, address]}.__getitem__)
    assert "is not public" in refusal(web, tmp_path, network=network)
    assert len(web.requests) == 1


def test_redirects_to_public_hosts_are_followed(web: WebServer, tmp_path: Path) -> None:
    """As Hugging Face and releases of GitHub do: to a signed address of a long name."""
    there = "/signed" + "a" * 2500 + "?Expires=5"
    web.answers["/files/preds.npz"] = redirect(f"https://{OTHER}{there}")
    web.answers[there] = plain(CONTENT)
    assert arrived(web, tmp_path).name == "preds.npz"
    assert f"\r\nHost: {OTHER}\r\n".encode() in web.requests[1]


def test_redirects_without_end(web: WebServer, tmp_path: Path) -> None:
    web.answers["/files/preds.npz"] = redirect("/files/preds.npz")
    assert "leads on more than 5 times" in refusal(web, tmp_path)
    assert len(web.requests) == 6
