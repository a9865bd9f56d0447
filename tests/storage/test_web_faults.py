"""Web servers that refuse, break off, or answer what is no answer."""

from __future__ import annotations

import gzip
import socket
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import pytest

from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage import remote
from airzoo_bench.storage.here import here
from airzoo_bench.storage.remote import Entry, read_range
from airzoo_bench.storage.urls import url_of
from tests.storage.faults import CONTENT, always, partial_files
from tests.storage.servers import Answer, Asked, Front, files_of, serving
from tests.support import run_main


def test_a_web_server_without_ranges(tmp_path: Path, mirrors: Path) -> None:
    (tmp_path / "p.npz").write_bytes(CONTENT)
    with serving(files_of(tmp_path, ranges=False, listing=False)) as front:
        url = f"{front.address}/p.npz"
        assert here(url).read_bytes() == CONTENT
        assert read_range(url, 0, 100) == CONTENT[:100]
        with pytest.raises(StorageError, match="sends no ranges"):
            read_range(url, 100, 100)


def test_a_web_download_goes_on_where_it_broke(web: tuple[Path, Front], mirrors: Path) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(CONTENT)

    def cut(asked: Asked, real: Answer) -> Answer:
        body = real.body[: len(real.body) // 2]
        return Answer(real.status, real.headers, body, real.stated_size or len(real.body))

    front.change = cut
    with pytest.raises(StorageError, match=r"p\.npz: cannot be reached"):
        here(f"{front.address}/p.npz")
    assert not list(mirrors.rglob("p.npz"))
    assert len(partial_files(mirrors)) == 1
    front.change = None
    front.sent.clear()
    assert here(f"{front.address}/p.npz").read_bytes() == CONTENT
    assert front.sent["/p.npz"] <= len(CONTENT) / 2


def test_a_web_download_that_breaks_off_is_tried_again(
    web: tuple[Path, Front], mirrors: Path
) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(CONTENT)
    front.change = once(lambda real: Answer(200, real.headers, real.body[:6000], len(CONTENT)))
    assert here(f"{front.address}/p.npz").read_bytes() == CONTENT
    first, second = (one.headers.get("Range") for one in front.asked if one.method == "GET")
    assert first is None
    assert second is not None
    assert 0 < int(second.removeprefix("bytes=").removesuffix("-")) <= 6000


def once(change: Callable[[Answer], Answer]) -> Callable[[Asked, Answer], Answer]:
    """Change the first answer with a body."""
    left = [change]
    return lambda asked, real: left.pop()(real) if left and asked.method == "GET" else real


def test_an_answer_that_is_no_http_is_tried_again(mirrors: Path) -> None:
    pytest.importorskip("aiohttp", reason="the extra storage is not installed")
    answers = [b"nonsense\r\n\r\n", b"HTTP/1.1 404 None\r\nContent-Length: 0\r\n\r\n"]
    with socket.create_server(("127.0.0.1", 0)) as server:
        Thread(target=answer_each, args=(server, answers), daemon=True).start()
        with pytest.raises(StorageError, match="no such"):
            read_range(f"http://127.0.0.1:{server.getsockname()[1]}/p.npz", 0, 10)


def answer_each(server: socket.socket, answers: list[bytes]) -> None:
    for answer in answers:
        with server.accept()[0] as connection:
            connection.recv(1 << 16)
            connection.sendall(answer)


@pytest.mark.parametrize(("status", "said"), [(404, "no such"), (403, "denied"), (503, "503")])
def test_what_a_web_server_refuses(
    web: tuple[Path, Front], status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _, front = web
    front.change = always(Answer(status, {}))
    assert run_main("check", f"{front.address}/p.npz?signature=secret") == 2
    message = capsys.readouterr().err
    assert said in message
    assert "/p.npz?…" in message
    assert "secret" not in message


def web_fault(web: tuple[Path, Front], change: Callable[[Asked, Answer], Answer]) -> str:
    folder, front = web
    (folder / "p.npz").write_bytes(CONTENT)
    front.change = change
    with pytest.raises(StorageError) as caught:
        here(f"{front.address}/p.npz")
    return str(caught.value)


def test_a_file_that_a_server_packs_is_not_unpacked(web: tuple[Path, Front], mirrors: Path) -> None:
    def pack(asked: Asked, real: Answer) -> Answer:
        body = gzip.compress(bytes(1 << 20))
        size = len(body) if asked.method == "HEAD" else None
        return Answer(200, real.headers | {"Content-Encoding": "gzip"}, body, size)

    assert "packed by gzip" in web_fault(web, pack)
    assert not list(mirrors.rglob("p.npz"))


@pytest.mark.parametrize("given", [{}, {"Content-Range": "bytes 0-99/10240"}])
def test_a_part_must_be_the_one_that_was_asked_for(
    web: tuple[Path, Front], mirrors: Path, given: dict[str, str]
) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(CONTENT)
    front.change = lambda _, real: Answer(206, given, real.body) if real.body else real
    with pytest.raises(StorageError, match="other bytes than it was asked for"):
        read_range(f"{front.address}/p.npz", 100, 100)


def test_a_body_without_end_is_not_fetched_to_its_end(
    web: tuple[Path, Front], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(CONTENT)
    url, part = url_of(f"{front.address}/p.npz"), tmp_path / "part"
    assert url is not None
    monkeypatch.setattr("airzoo_bench.storage.web._CHUNK_BYTES", 64)
    remote.fetch_onto(url, Entry(1000, "v"), part)
    assert 1000 < part.stat().st_size < 1100  # more than is stated: not that file
    part.unlink()
    monkeypatch.setattr(remote.shutil, "disk_usage", lambda _: SimpleNamespace(free=2000))
    with pytest.raises(StorageError, match="states no size"):
        remote.fetch_onto(url, Entry(None, "v"), part)
    assert not part.exists()
