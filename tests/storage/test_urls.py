"""URLs that cannot be read or written, and what messages show of them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.storage.mirror import here
from airzoo_bench.storage.urls import Url, copy_of, in_urls, url_at, url_of
from tests.support import run_main


@pytest.mark.parametrize(
    "location", ["ftp://host/data", "s3://", "https:///data", "s3://b/key?versionId=3"]
)
def test_no_url_that_can_be_read(location: str, capsys: pytest.CaptureFixture[str]) -> None:
    for call in (
        ("check", location),
        ("eval", "retrieval", "p.npz", "--data", location),
        ("table", location),
    ):
        assert run_main(*call) == 2, call
        message = capsys.readouterr().err
        assert "s3://, gs://, hf://, https://" in message, call


def test_nothing_is_written_to_urls(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("eval", "retrieval", "p.npz", "--out", "s3://bucket/runs") == 2
    assert "looks like a URL, and this is written to a disk" in capsys.readouterr().err


def test_a_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch, mirrors: Path) -> None:
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    with pytest.raises(UserError, match="gs:// needs the package gcsfs") as caught:
        here("gs://bucket/p.npz")
    assert caught.value.fix == "pip install 'airzoo-bench[storage]'"


@pytest.mark.parametrize(
    "address",
    [
        "http://me:secret@127.0.0.1:1/p.npz",
        "http://127.0.0.1:1/p.npz?k=secret",
        "http://me:secret@[::1/p.npz",
        "ftp://me:secret@host/p.npz",
    ],
)
def test_a_password_is_in_no_message(
    address: str, mirrors: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("check", address) == 2
    message = capsys.readouterr().err
    assert message.startswith("airzoo-bench: ")
    assert "secret" not in message


def test_a_place_below_a_url() -> None:
    url = url_of("https://host/a%20b/c?key=secret")
    assert url is not None
    assert str(url) == "https://host/a b/c?…"
    assert url.child("d e").address == "https://host/a%20b/c/d%20e?key=secret"
    assert url_at(copy_of(url)) == Url("https", "host/a b/c")
    assert in_urls(f"{copy_of(url)}: wrong") == "https://host/a b/c: wrong"
    assert url_at(Path("/elsewhere")) is None
    assert url_of("a/path") is None
