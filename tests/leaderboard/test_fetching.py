"""Predictions by address, against a real https server and every trick that hosts have played."""

from __future__ import annotations

import gzip
import itertools
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.addresses import WebAddress, public_addresses
from airzoo_bench.leaderboard.fetching import Patience, fetch
from tests.leaderboard.web_server import (
    HOST,
    PUBLIC,
    WebServer,
    head,
    plain,
    running_server,
    sha256,
)

CONTENT = b"predictions" * 30_000
URL = f"https://{HOST}/files/preds.npz"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebServer]:
    with running_server(tmp_path_factory.mktemp("authority")) as found:
        yield found


@pytest.fixture(autouse=True)
def _forget(server: WebServer) -> None:
    server.answers.clear()
    server.requests.clear()
    server.dialled.clear()


def refusal(server: WebServer, into: Path, url: str = URL, **changes: object) -> str:
    """Fetch what must not arrive; nothing of it may be left on disk."""
    settings = {"size": len(CONTENT), "sha256": sha256(CONTENT), "network": server.network()}
    with pytest.raises(SubmissionError) as caught:
        fetch(url, into, **(settings | changes))  # type: ignore[arg-type]
    assert not into.exists() or not list(into.iterdir())
    return str(caught.value)


class TestFiles:
    def test_arrives_from_the_pinned_address_under_its_name(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        server.answers["/files/preds.npz"] = plain(CONTENT)
        found = fetch(
            URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=server.network()
        )
        assert found == tmp_path / "preds.npz"
        assert found.read_bytes() == CONTENT
        assert server.dialled == [PUBLIC]
        assert b"\r\nHost: data.example.org\r\n" in server.requests[0]
        assert b"\r\nAccept-Encoding: identity\r\n" in server.requests[0]

    def test_what_is_there_already_is_not_fetched_again(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        (tmp_path / "preds.npz").write_bytes(CONTENT)
        fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=server.network())
        assert server.dialled == []

    def test_chunked_answers_arrive(self, server: WebServer, tmp_path: Path) -> None:
        body = f"{len(CONTENT):x}\r\n".encode() + CONTENT + b"\r\n0\r\n\r\n"
        server.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head("Transfer-Encoding: chunked") + body
        )
        network = server.network()
        found = fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=network)
        assert found.read_bytes() == CONTENT

    def test_the_second_address_is_tried_where_the_first_takes_no_connection(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        server.answers["/files/preds.npz"] = plain(CONTENT)
        network = server.network(lambda host: ["93.184.215.99", PUBLIC])

        def connect(address: str, timeout: float) -> socket.socket:
            if address != PUBLIC:
                raise ConnectionRefusedError("refused")
            return server.connect(address, timeout)

        chosen = type(network)(network.resolve, connect, network.trust, network.patience)
        fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=chosen)
        assert server.dialled == [PUBLIC]

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


@pytest.mark.parametrize(
    "url",
    [
        "http://data.example.org/a.npz",
        "file:///etc/passwd",
        "ftp://data.example.org/a.npz",
        "//data.example.org/a.npz",
        "https:data.example.org",
        "https:///a.npz",
        "https://user@data.example.org/a.npz",
        "https://data.example.org@127.0.0.1/a.npz",
        "https://data.example.org:8443/a.npz",
        "https://data.example.org:/a.npz",
        "https://data.example.org./a.npz",
        "https://localhost/a.npz",
        "https://127.0.0.1/a.npz",
        "https://2130706433/a.npz",
        "https://0x7f.0.0.1/a.npz",
        "https://0177.0.0.1/a.npz",
        "https://127.1/a.npz",
        "https://[::1]/a.npz",
        "https://[::ffff:127.0.0.1]/a.npz",
        "https://169.254.169.254/latest/meta-data",
        "https://dаta.example.org/a.npz",  # a Cyrillic letter
        "https://xn--dta-7cd.example.org/a.npz",
        "https://data。example。org/a.npz",
        "https://data.example.org/a\r\nHost: other.org",
        "https://data.example.org/a b",
        "https://data.example.org\\@127.0.0.1/a.npz",
        "https://data_x.example.org/a.npz",
        "https://data..example.org/a.npz",
        "https://data.example.org/" + "a" * 3000,
        "",
    ],
)
def test_addresses_that_are_not_taken(url: str, server: WebServer, tmp_path: Path) -> None:
    def nobody(host: str) -> list[str]:
        raise AssertionError("an address that is refused must not be resolved")

    message = refusal(server, tmp_path, url, network=server.network(nobody))
    assert "expected: https://HOST/PATH" in message
    assert message.isprintable() or "\n  expected" in message
    assert "\r" not in message


def test_an_address_with_a_user_is_told_so() -> None:
    with pytest.raises(SubmissionError, match="has a user name"):
        WebAddress.parse("https://data.example.org@127.0.0.1/a.npz")


class TestPublicHosts:
    @pytest.mark.parametrize(
        "address",
        [
            "127.0.0.1",
            "127.8.8.8",
            "0.0.0.0",
            "10.1.2.3",
            "172.16.0.1",
            "192.168.1.1",
            "100.64.0.1",
            "169.254.169.254",
            "192.0.0.170",
            "192.0.2.1",
            "198.18.0.1",
            "192.88.99.1",
            "224.0.0.1",
            "240.0.0.1",
            "255.255.255.255",
            "::",
            "::1",
            "::127.0.0.1",
            "::ffff:127.0.0.1",
            "::ffff:93.184.215.14",
            "fe80::1",
            "fe80::1%eth0",
            "fc00::1",
            "fec0::1",
            "fd00:ec2::254",
            "ff02::1",
            "2001::1",
            "2001:db8::1",
            "2002:7f00:1::",
            "64:ff9b::7f00:1",
            "64:ff9b:1::7f00:1",
            "not an address",
        ],
    )
    def test_others_are_refused_before_any_connection(
        self, address: str, server: WebServer, tmp_path: Path
    ) -> None:
        network = server.network(lambda host: [PUBLIC, address])
        assert "is not public" in refusal(server, tmp_path, network=network)
        assert server.dialled == []

    def test_public_ones_are_taken(self) -> None:
        found = ["93.184.215.14", "8.8.8.8", "2606:2800:21f:cb07::1"]
        assert public_addresses(HOST, lambda host: found) == found

    def test_a_name_of_this_machine_is_refused_with_the_real_resolver(self, tmp_path: Path) -> None:
        with pytest.raises(SubmissionError, match=r"cannot be found|is not public"):
            fetch("https://airzoo.localhost/a.npz", tmp_path, size=1, sha256="0" * 64)

    def test_a_name_that_leads_elsewhere_the_second_time_is_asked_once(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        asked = iter([[PUBLIC], ["127.0.0.1"], ["169.254.169.254"]])
        server.answers["/files/preds.npz"] = redirect("/moved.npz")
        server.answers["/moved.npz"] = plain(CONTENT)
        network = server.network(lambda host: next(asked))
        fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=network)
        assert server.dialled == [PUBLIC, PUBLIC]
        assert next(asked) == ["127.0.0.1"]

    @pytest.mark.parametrize("found", [OSError("no such name"), []])
    def test_hosts_without_address(
        self, found: OSError | list[str], server: WebServer, tmp_path: Path
    ) -> None:
        def resolve(host: str) -> list[str]:
            if isinstance(found, OSError):
                raise found
            return found

        assert HOST in refusal(server, tmp_path, network=server.network(resolve))


def redirect(location: str, status: str = "302 Found"):  # type: ignore[no-untyped-def]
    return lambda _, peer: peer.sendall(
        head(f"Location: {location}", "Content-Length: 0", status=status)
    )


class TestRedirects:
    @pytest.mark.parametrize(
        "location",
        [
            "https://169.254.169.254/latest",
            "https://127.0.0.1/x",
            "https://[::1]/x",
            "http://data.example.org/x",
            "file:///etc/passwd",
            "https://user@data.example.org/x",
            "//127.0.0.1/x",
        ],
    )
    def test_to_what_is_not_taken_are_refused(
        self, location: str, server: WebServer, tmp_path: Path
    ) -> None:
        server.answers["/files/preds.npz"] = redirect(location)
        refusal(server, tmp_path)
        assert server.dialled == [PUBLIC]

    def test_to_another_host_name_the_final_address(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        there = "https://cdn.example.net/signed?Expires=5"
        server.answers["/files/preds.npz"] = redirect(there)
        message = refusal(server, tmp_path)
        assert "another host, cdn.example.net" in message
        assert there in message
        assert server.dialled == [PUBLIC]

    def test_without_end(self, server: WebServer, tmp_path: Path) -> None:
        server.answers["/files/preds.npz"] = redirect("/files/preds.npz")
        assert "leads on more than 5 times" in refusal(server, tmp_path)
        assert len(server.dialled) == 6

    def test_text_of_the_host_is_never_printed_as_it_is(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        server.answers["/files/preds.npz"] = redirect("https://evil.example/\x1b[2Jgone")
        assert "\x1b" not in refusal(server, tmp_path)
        server.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head(status="500 \x1b[31mred")
        )
        assert "\x1b" not in refusal(server, tmp_path)


class TestContent:
    def test_endless_body_is_cut_at_the_first_byte_too_many(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        sent = itertools.count()

        def endless(_: str, peer: socket.socket) -> None:
            peer.sendall(head())
            with suppress(OSError):
                while True:
                    peer.sendall(bytes(1 << 16))
                    next(sent)

        server.answers["/files/preds.npz"] = endless
        assert "more than" in refusal(server, tmp_path, size=1 << 20)
        time.sleep(0.1)
        assert next(sent) < 1000  # 64 MB: what buffers of both ends hold, not what could be sent

    def test_stated_length_that_is_not_the_submission_s(
        self, server: WebServer, tmp_path: Path
    ) -> None:
        server.answers["/files/preds.npz"] = plain(CONTENT + b"x")
        message = refusal(server, tmp_path)
        assert f"{len(CONTENT) + 1} bytes" in message
        assert f"expected: {len(CONTENT)} bytes" in message

    def test_length_that_lies(self, server: WebServer, tmp_path: Path) -> None:
        server.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head(f"Content-Length: {len(CONTENT)}") + CONTENT[:-1000]
        )
        assert "ended after" in refusal(server, tmp_path)
        server.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head(f"Content-Length: {len(CONTENT)}") + CONTENT[1000:] + bytes(5000)
        )
        assert "SHA-256" in refusal(server, tmp_path)

    def test_compressed_bomb(self, server: WebServer, tmp_path: Path) -> None:
        bomb = gzip.compress(bytes(len(CONTENT)))
        server.answers["/files/preds.npz"] = plain(bomb, "Content-Encoding: gzip")
        assert "compresses the answer" in refusal(server, tmp_path)

    def test_other_content(self, server: WebServer, tmp_path: Path) -> None:
        server.answers["/files/preds.npz"] = plain(CONTENT[::-1])
        message = refusal(server, tmp_path)
        assert sha256(CONTENT[::-1]) in message
        assert sha256(CONTENT) in message

    def test_a_failed_fetch_leaves_what_was_there(self, server: WebServer, tmp_path: Path) -> None:
        (tmp_path / "preds.npz").write_bytes(b"earlier")
        server.answers["/files/preds.npz"] = plain(CONTENT[::-1])
        with pytest.raises(SubmissionError):
            fetch(
                URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=server.network()
            )
        assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("preds.npz", b"earlier")]

    @pytest.mark.parametrize("status", ["404 Not Found", "206 Partial Content", "204 No Content"])
    def test_other_answers(self, status: str, server: WebServer, tmp_path: Path) -> None:
        server.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head("Content-Length: 0", status=status)
        )
        assert f"answers {status}" in refusal(server, tmp_path)

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
    def test_what_is_no_http(self, answer: bytes, server: WebServer, tmp_path: Path) -> None:
        server.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(answer)
        assert URL in refusal(server, tmp_path)


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
        self, begin: bytes, drop: bytes, server: WebServer, tmp_path: Path
    ) -> None:
        server.answers["/files/preds.npz"] = self.drip(begin, drop)
        network = server.network(patience=Patience(5.0, answer=0.5, slowest=1e9, longest=0.5))
        assert "too slow" in refusal(server, tmp_path, network=network)

    def test_a_silent_host_is_left(self, server: WebServer, tmp_path: Path) -> None:
        server.answers["/files/preds.npz"] = lambda _, peer: time.sleep(3)
        network = server.network(patience=Patience(silence=0.2, answer=5.0))
        assert "too slow" in refusal(server, tmp_path, network=network)

    def test_larger_files_may_take_longer(self) -> None:
        patience = Patience(answer=60.0, slowest=100.0, longest=1000.0)
        assert [patience.of_body(size) for size in (0, 1000, 10**9)] == [60.0, 70.0, 1000.0]


class TestCertificates:
    def test_of_an_unknown_authority(self, server: WebServer, tmp_path: Path) -> None:
        network = server.network(trust=ssl.create_default_context())
        assert "certificate" in refusal(server, tmp_path, network=network)
        assert server.requests == []

    def test_of_another_host(self, server: WebServer, tmp_path: Path) -> None:
        other = "https://other.example.org/files/preds.npz"
        assert "certificate" in refusal(server, tmp_path, other)
        assert server.requests == []
