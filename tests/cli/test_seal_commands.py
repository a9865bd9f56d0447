"""``seal`` and its keys: one message for each fault, exit code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.leaderboard.sealing import KEY_VARIABLE, load_pyrage, read_key
from tests.api.place import NAME
from tests.leaderboard.sealed.conftest import SealedField, field, sealed
from tests.support import run_main

__all__ = ["field", "sealed"]

RECIPIENT = str(load_pyrage().x25519.Identity.generate().to_public())


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)


def refused(capsys: pytest.CaptureFixture[str], *call: object) -> str:
    assert run_main(*call) == 2
    said = capsys.readouterr().err
    assert said.count("airzoo-bench: ") == 1
    assert "Traceback" not in said
    return said


KEYS = {
    "none": "",
    "two": "KEY\nKEY\n",
    "public": RECIPIENT,
    "damaged": "KEY!",
}


@pytest.mark.parametrize("name", KEYS)
def test_faults_of_keys(name: str, sealed: SealedField, monkeypatch: pytest.MonkeyPatch) -> None:
    secret = str(sealed.key)
    monkeypatch.setenv(KEY_VARIABLE, KEYS[name].replace("KEY", secret))
    with pytest.raises(UsageError) as caught:
        read_key()
    assert KEY_VARIABLE in str(caught.value)
    assert secret[20:40] not in str(caught.value)


def test_a_key_with_comments_and_none(sealed: SealedField, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match=KEY_VARIABLE):
        read_key()
    monkeypatch.setenv(KEY_VARIABLE, f"# a comment\n{sealed.key}\n")
    assert str(read_key()) == str(sealed.key)


def test_faults_of_recipients(sealed: SealedField, capsys: pytest.CaptureFixture[str]) -> None:
    call = ("seal", sealed.folder, "--out", "p/m", "--archive", "p/a.age", "--to")
    assert "no recipient: 'me'" in refused(capsys, *call, "me")
    said = refused(capsys, *call, str(sealed.key))
    assert "this is the secret key" in said
    assert str(sealed.key)[20:40] not in said


def test_faults_of_places(sealed: SealedField, capsys: pytest.CaptureFixture[str]) -> None:
    to = ("--to", RECIPIENT)
    assert "lie in two folders" in refused(
        capsys, "seal", sealed.folder, "--out", "p/m", "--archive", "q/a.age", *to
    )
    inside = sealed.folder / "public"
    assert "lies in the folder that is sealed" in refused(
        capsys, "seal", sealed.folder, "--out", inside, "--archive", inside.with_name("a.age"), *to
    )
    where = ("--out", "p/m", "--archive", "p/a.age")
    assert "fix:      give its path" in refused(capsys, "seal", "made", *where, *to)
    assert "is sealed" in refused(capsys, "seal", sealed.public, *where, *to)
    assert run_main("seal", sealed.folder, *where, *to) == 0
    capsys.readouterr()
    assert "exists already" in refused(capsys, "seal", sealed.folder, *where, *to)
    assert run_main("seal", sealed.folder, *where, *to, "--force") == 0


def test_the_template_of_a_sealed_benchmark_is_checked_next(
    sealed: SealedField, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ("template", f"{NAME}-matching", "--data", sealed.public)
    assert run_main(*call) == 0
    assert (
        f"next: airzoo-bench check template.npz --data {sealed.public}" in capsys.readouterr().err
    )
