"""URLs that cannot be read or written, and what messages show of them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.storage.mirror import here
from airzoo_bench.storage.urls import safe_name, url_of
from tests.support import run_main


@pytest.mark.parametrize(
    "location", ["ftp://host/data", "s3://", "https:///data", "s3://b/key?versionId=3"]
)
def test_no_url_that_can_be_read(
    location: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for call in (
        ("check", location),
        ("eval", "retrieval", "p.npz", "--data", location),
        ("eval", "retrieval", "p.npz", "--data", tmp_path, "--out", location),
        ("table", location),
    ):
        assert run_main(*call) == 2, call
        message = capsys.readouterr().err
        assert "s3://, gs://, hf://, https://" in message, call


def test_a_url_with_one_slash(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s3:").mkdir()
    (tmp_path / "s3:" / "there.npz").touch()
    for call in (
        ("check", "s3:/bucket/p.npz"),
        ("eval", "retrieval", "p.npz", "--data", "s3:/bucket"),
        ("eval", "retrieval", "p.npz", "--data", tmp_path, "--out", "s3:/bucket/out"),
    ):
        assert run_main(*call) == 2, call
        said = capsys.readouterr().err
        assert "s3:/…: a URL lacks a slash" in said, call
        assert "write s3://…" in said, call
    assert run_main("check", "s3:/there.npz") == 2
    assert "lacks a slash" not in capsys.readouterr().err  # a path that is there is a path


@pytest.mark.parametrize(
    "call",
    [
        "plot recall r.json --out s3://bucket/a.png",
        "report r.json --out s3://bucket/a.html",
        "prepare photos --name park --images i --poses p.json --dom d.tif --plane-height 0 --out s3://bucket/park",
    ],
)
def test_only_runs_are_written_to_urls(call: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*call.split()) == 2
    assert "looks like a URL, and this is written to a disk" in capsys.readouterr().err


def test_a_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch, mirrors: Path) -> None:
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    with pytest.raises(UserError, match="gs:// needs the package gcsfs") as caught:
        here("gs://bucket/p.npz")
    assert caught.value.fix == "pip install 'airzoo-bench[storage]'"


@pytest.mark.parametrize(
    "address",
    [
        "http://me:secret@127.0.0.1:1/p.npz?k=secret",
        "http://me:secret@[::1/p.npz",
        "https://me:secret@\u2100.org/p",
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


def test_passwords_and_signatures_are_not_shown() -> None:
    url = url_of("https://me:secret@host/a%20b/c?key=secret")
    assert str(url) == "https://host/a%20b/c?…"
    assert url is not None
    host = url_of("https://me:secret@host:80/?key=secret")
    assert host is not None
    assert safe_name(host) == "host_80"  # a folder that messages and results may name
    assert url.child("d e").address == "https://me:secret@host/a%20b/c/d%20e?key=secret"
