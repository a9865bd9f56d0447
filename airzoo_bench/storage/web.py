"""Ranges of files on web servers, streamed: a server that knows none must not fill the memory."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage.faults import check_version
from airzoo_bench.storage.urls import Url

__all__ = ["fetch_behind", "web_range"]

_CHUNK_BYTES = 1 << 20
_PARTIAL = 206


@asynccontextmanager
async def _answer(
    client: Any, url: Url, version: str, start: int, end: int | None = None
) -> AsyncIterator[Any]:
    """Ask for the bytes from `start` on, up to `end`; for a file as a whole without a range."""
    session = await client.set_session()
    headers = {"Accept-Encoding": "identity"}
    if start or end is not None:
        headers["Range"] = f"bytes={start}-{'' if end is None else end}"
    async with session.get(client.encode_url(url.address), headers=headers) as answer:
        answer.raise_for_status()
        _check_answer(url, answer, start)
        check_version(url, version, answer.headers)
        yield answer


def _check_answer(url: Url, answer: Any, start: int) -> None:
    packed = answer.headers.get("Content-Encoding", "identity")
    if packed.lower() != "identity":  # a few bytes may unpack to any number
        raise StorageError(
            f"the server sends the file packed by {packed[:20]}, though it was asked not to",
            where=url,
            fix="have it send files as they are; in an object storage, upload without a content "
            "encoding",
        )
    given = answer.headers.get("Content-Range", "")
    if answer.status == _PARTIAL and not given.startswith(f"bytes {start}-"):
        raise StorageError(
            "the server sends other bytes than it was asked for",
            where=url,
            expected=f"bytes {start:,} and on",
            fix="use a server that sends ranges: any object storage, nginx, Apache",
        )


def web_range(client: Any, url: Url, offset: int, length: int, version: str) -> bytes:
    """Read bytes of a file; fewer where it ends before."""
    from fsspec.asyn import sync

    async def read() -> bytes:
        found = bytearray()
        async with _answer(client, url, version, offset, offset + length - 1) as answer:
            if answer.status != _PARTIAL and offset:
                raise StorageError(
                    "the server sends no ranges of files",
                    where=url,
                    fix="use a server that does: any object storage, nginx, Apache",
                )
            while len(found) < length:
                chunk = await answer.content.read(min(_CHUNK_BYTES, length - len(found)))
                if not chunk:
                    break
                found += chunk
        return bytes(found)

    data: bytes = sync(client.loop, read)
    return data


def fetch_behind(client: Any, url: Url, part: Path, most: int, version: str) -> None:
    """Fetch a file behind the bytes that `part` has, or anew where the server knows no ranges."""
    from fsspec.asyn import sync

    done = part.stat().st_size if part.exists() else 0

    async def fetch() -> None:
        async with _answer(client, url, version, done) as answer:
            with part.open("ab" if answer.status == _PARTIAL else "wb") as stream:
                while stream.tell() <= most and (chunk := await answer.content.read(_CHUNK_BYTES)):
                    stream.write(chunk)

    sync(client.loop, fetch)
