"""A real https server on this machine, with a test CA, that answers whatever a test has it say."""

from __future__ import annotations

import hashlib
import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.fetching import Network, fetch

HOST, OTHER = "data.example.org", "cdn.example.net"
URL = f"https://{HOST}/files/preds.npz"
CONTENT = b"predictions" * 30_000
PUBLIC = "93.184.215.14"

Answer = Callable[[str, socket.socket], None]


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def head(*lines: str, status: str = "200 OK") -> bytes:
    return "\r\n".join([f"HTTP/1.1 {status}", *lines, "", ""]).encode()


def plain(content: bytes, *lines: str) -> Answer:
    """Answer as an honest server does."""
    return lambda _, peer: peer.sendall(head(f"Content-Length: {len(content)}", *lines) + content)


def redirect(location: str, status: str = "302 Found") -> Answer:
    lines = (f"Location: {location}", "Content-Length: 0")
    return lambda _, peer: peer.sendall(head(*lines, status=status))


def make_authority(folder: Path, *names: str) -> tuple[Path, Path]:
    """Make a self-signed certificate for host names, which is its own authority; and its key."""
    certificate, key = folder / "cert.pem", folder / "key.pem"
    hosts = ",".join(f"DNS:{name}" for name in names)
    call = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    call += ["-subj", "/CN=airzoo-bench tests", "-addext", f"subjectAltName={hosts}"]
    call += ["-keyout", str(key), "-out", str(certificate)]
    subprocess.run(call, check=True, capture_output=True)
    return certificate, key


@dataclass
class WebServer:
    """The requests so far, and the network on which every host leads to this server."""

    port: int
    certificate: Path
    answers: dict[str, Answer] = field(default_factory=dict)
    requests: list[bytes] = field(default_factory=list)

    def network(
        self,
        resolve: Callable[[str], list[str]] = lambda host: [PUBLIC],
        trusted: bool = True,
    ) -> Network:
        here = ("127.0.0.1", self.port)
        return Network(resolve, lambda _: here, self.certificate if trusted else None)

    def serve(self, plain_peer: socket.socket, context: ssl.SSLContext) -> None:
        with suppress(OSError), context.wrap_socket(plain_peer, server_side=True) as peer:
            request = b""
            while b"\r\n\r\n" not in request and (more := peer.recv(4096)):
                request += more
            self.requests.append(request)
            path = request.split(b" ")[1].decode()
            answer = self.answers.get(path)
            if answer is None:
                peer.sendall(head("Content-Length: 0", status="404 Not Found"))
            else:
                answer(path, peer)


@contextmanager
def running_server(folder: Path, *names: str) -> Iterator[WebServer]:
    certificate, key = make_authority(folder, *(names or (HOST, OTHER)))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = WebServer(listener.getsockname()[1], certificate)

        def accept() -> None:
            with suppress(OSError):
                while True:
                    peer, _ = listener.accept()
                    peer.settimeout(60)
                    threading.Thread(target=server.serve, args=(peer, context), daemon=True).start()

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        yield server
        listener.shutdown(socket.SHUT_RDWR)
    thread.join()


def refusal(server: WebServer, into: Path, url: str = URL, **changes: Any) -> str:
    """Fetch what must not arrive; nothing of it may be left on disk."""
    settings = {"size": len(CONTENT), "sha256": sha256(CONTENT), "network": server.network()}
    with pytest.raises(SubmissionError) as caught:
        fetch(url, into, **(settings | changes))
    assert not into.exists() or not list(into.iterdir())
    return str(caught.value)
