"""Predictions by address, against a real https server and every trick that hosts have played."""

from __future__ import annotations

import gzip
import itertools
import socket
import ssl
import time
from contextlib import suppress
from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.addresses import WebAddress
from airzoo_bench.leaderboard.fetching import Patience, fetch
from tests.leaderboard.web_server import (
    CONTENT,
    HOST,
    PUBLIC,
    URL,
    WebServer,
    head,
    plain,
    redirect,
    refusal,
    sha256,
)
from tests.support import HANGS_S


class TestFiles:
    def test_arrives_from_the_pinned_address_under_its_name(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = plain(CONTENT)
        found = fetch(
            URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=web.network()
        )
        assert found == tmp_path / "preds.npz"
        assert found.read_bytes() == CONTENT
        assert web.dialled == [PUBLIC]
        assert b"\r\nHost: data.example.org\r\n" in web.requests[0]
        assert b"\r\nAccept-Encoding: identity\r\n" in web.requests[0]

    def test_what_is_there_already_is_not_fetched_again(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        (tmp_path / "preds.npz").write_bytes(CONTENT)
        fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=web.network())
        assert web.dialled == []

    def test_chunked_answers_arrive(self, web: WebServer, tmp_path: Path) -> None:
        body = f"{len(CONTENT):x}\r\n".encode() + CONTENT + b"\r\n0\r\n\r\n"
        web.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head("Transfer-Encoding: chunked") + body
        )
        network = web.network()
        found = fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=network)
        assert found.read_bytes() == CONTENT

    def test_the_second_address_is_tried_where_the_first_takes_no_connection(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = plain(CONTENT)
        network = web.network(lambda host: ["93.184.215.99", PUBLIC])

        def connect(address: str, timeout: float) -> socket.socket:
            if address != PUBLIC:
                raise ConnectionRefusedError("refused")
            return web.connect(address, timeout)

        chosen = type(network)(network.resolve, connect, network.trust, network.patience)
        fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=chosen)
        assert web.dialled == [PUBLIC]

    @pytest.mark.parametrize(
        ("path", "name"),
        [
            ("/a/preds.npz?download=1", "preds.npz"),
            ("/api/records/7/files/salad.zip/content", "salad.zip"),
            ("/a/..%2f..%2fetc.passwd", "etc.passwd"),
            ("/a/.ssh", "predictions"),
            ("/", "predictions"),
        ],
    )
    def test_names(self, path: str, name: str) -> None:
        assert WebAddress.parse(f"https://{HOST}{path}").file_name == name


class TestContent:
    def test_endless_body_is_cut_at_the_first_byte_too_many(
        self, web: WebServer, tmp_path: Path
    ) -> None:
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
        assert next(sent) < 1000  # 64 MB: what buffers of both ends hold, not what could be sent

    def test_stated_length_that_is_not_the_submission_s(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = plain(CONTENT + b"x")
        message = refusal(web, tmp_path)
        assert f"{len(CONTENT) + 1} bytes" in message
        assert f"expected: {len(CONTENT)} bytes" in message

    def test_length_that_lies(self, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head(f"Content-Length: {len(CONTENT)}") + CONTENT[:-1000]
        )
        assert "ended after" in refusal(web, tmp_path)
        web.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head(f"Content-Length: {len(CONTENT)}") + CONTENT[1000:] + bytes(5000)
        )
        assert "SHA-256" in refusal(web, tmp_path)

    def test_compressed_bomb(self, web: WebServer, tmp_path: Path) -> None:
        bomb = gzip.compress(bytes(len(CONTENT)))
        web.answers["/files/preds.npz"] = plain(bomb, "Content-Encoding: gzip")
        assert "compresses the answer" in refusal(web, tmp_path)

    def test_other_content(self, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = plain(CONTENT[::-1])
        message = refusal(web, tmp_path)
        assert sha256(CONTENT[::-1]) in message
        assert sha256(CONTENT) in message

    def test_a_failed_fetch_leaves_what_was_there(self, web: WebServer, tmp_path: Path) -> None:
        (tmp_path / "preds.npz").write_bytes(b"earlier")
        web.answers["/files/preds.npz"] = plain(CONTENT[::-1])
        with pytest.raises(SubmissionError):
            fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=web.network())
        assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("preds.npz", b"earlier")]

    @pytest.mark.parametrize("status", ["404 Not Found", "206 Partial Content", "204 No Content"])
    def test_other_answers(self, status: str, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head("Content-Length: 0", status=status)
        )
        assert f"answers {status}" in refusal(web, tmp_path)

    @pytest.mark.parametrize(
        "answer",
        [
            b"",
            b"no HTTP at all\r\n\r\n",
            b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 200 + b"\r\n",
            b"HTTP/1.1 200 OK\r\nX: " + b"y" * 100_000 + b"\r\n\r\n",
            b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzzz\r\n",
        ],
    )
    def test_what_is_no_http(self, answer: bytes, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(answer)
        assert URL in refusal(web, tmp_path)


class TestTime:
    def drip(self, begin: bytes, drop: bytes):  # type: ignore[no-untyped-def]
        def answer(_: str, peer: socket.socket) -> None:
            with suppress(OSError):
                peer.sendall(begin)
                while True:
                    time.sleep(0.02)
                    peer.sendall(drop)

        return answer

    @pytest.mark.parametrize(
        ("begin", "drop"),
        [
            (b"", b"H"),
            (b"HTTP/1.1 200 OK\r\n", b"X"),
            (head(status="100 Continue"), head(status="100 Continue")),
            (head(f"Content-Length: {len(CONTENT)}"), b"p"),
            (head("Transfer-Encoding: chunked"), b"1\r\np\r\n"),
        ],
    )
    def test_a_host_that_drips_is_left(
        self, begin: bytes, drop: bytes, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = self.drip(begin, drop)
        network = web.network(patience=Patience(5.0, answer=0.5, slowest=1e9, longest=0.5))
        assert "too slow" in refusal(web, tmp_path, network=network)

    def test_a_silent_host_is_left(self, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = lambda _, peer: time.sleep(HANGS_S)
        network = web.network(patience=Patience(silence=0.2, answer=HANGS_S))
        assert "too slow" in refusal(web, tmp_path, network=network)

    def test_all_of_a_fetch_ends_in_half_of_what_is_left(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        """Each redirect and byte comes in time by itself, and the file does not."""

        def again(_: str, peer: socket.socket) -> None:
            time.sleep(0.1)
            redirect("/files/preds.npz")("", peer)

        begun = time.monotonic()
        for answer in (again, self.drip(head(), b"p")):
            web.answers["/files/preds.npz"] = answer
            until = time.monotonic() + 0.5
            assert "too slow" in refusal(web, tmp_path, until=until)
        assert time.monotonic() - begun < 5

    def test_no_file_is_asked_for_once_the_time_is_over(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        assert "too slow" in refusal(web, tmp_path, until=time.monotonic() - 1)
        assert web.dialled == []

    def test_larger_files_may_take_longer(self) -> None:
        patience = Patience(answer=60.0, slowest=100.0, longest=1000.0)
        assert [patience.of_file(size) for size in (0, 1000, 10**9)] == [60.0, 70.0, 1000.0]


class TestCertificates:
    def test_of_an_unknown_authority(self, web: WebServer, tmp_path: Path) -> None:
        network = web.network(trust=ssl.create_default_context())
        assert "certificate" in refusal(web, tmp_path, network=network)
        assert web.requests == []

    def test_of_another_host(self, web: WebServer, tmp_path: Path) -> None:
        other = "https://other.example.org/files/preds.npz"
        assert "certificate" in refusal(web, tmp_path, other)
        assert web.requests == []
