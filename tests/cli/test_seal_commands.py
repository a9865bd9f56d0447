"""``seal``, ``unseal``, ``seal-key``, ``seal-score``: one message for each fault, exit code 2."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from airzoo_bench.leaderboard.sealed.keys import KEY_VARIABLE, load_pyrage
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


def test_from_a_key_to_the_folder_again(
    sealed: SealedField, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("seal-key", "key.txt") == 0
    public = capsys.readouterr().out.strip()
    text = Path("key.txt").read_text()
    assert f"# public key: {public}" in text
    assert Path("key.txt").stat().st_mode & 0o077 == 0
    where = ("--archive", "p/a.age")
    assert run_main("seal", sealed.folder, "--out", "p/m", *where, "--to", public) == 0
    said = capsys.readouterr()
    assert text.splitlines()[-1] not in said.out + said.err
    assert run_main("unseal", "p/m", *where, "--key", "key.txt", "--out", "u") == 0
    assert Path("u/benchmark.toml").read_bytes() == (sealed.folder / "benchmark.toml").read_bytes()


def test_the_key_of_the_environment(sealed: SealedField, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, f"# a comment\n{sealed.key}\n")
    assert run_main("unseal", sealed.public, "--archive", sealed.archive, "--out", "u") == 0


KEYS = {
    "none": ("", "holds 0 keys"),
    "two": ("KEY\nKEY\n", "holds 2 keys"),
    "public": (RECIPIENT, "holds 0 keys"),
    "damaged": ("KEY!", "holds a key that is damaged"),
}


@pytest.mark.parametrize("name", KEYS)
def test_faults_of_keys(name: str, sealed: SealedField, capsys: pytest.CaptureFixture[str]) -> None:
    text, expected = KEYS[name]
    Path("key.txt").write_text(text.replace("KEY", str(sealed.key)))
    call = ("unseal", sealed.public, "--archive", sealed.archive, "--out", "u", "--key", "key.txt")
    said = refused(capsys, *call)
    assert expected in said
    assert str(sealed.key)[20:40] not in said
    assert not Path("u").exists()


def test_no_key_and_no_file_of_one(sealed: SealedField, capsys: pytest.CaptureFixture[str]) -> None:
    call = ("unseal", sealed.public, "--archive", sealed.archive, "--out", "u")
    assert "no key to open the archive with" in refused(capsys, *call)
    assert "no such key file" in refused(capsys, *call, "--key", "missing.txt")


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
    capsys.readouterr()
    assert "is there already" in refused(capsys, "seal-key", "p/a.age")
    key = ("--archive", "p/a.age", "--out", "u", "--key", "key.txt")
    Path("key.txt").write_text(str(sealed.key))
    assert "is not sealed" in refused(capsys, "unseal", sealed.folder, *key)
    assert "another key" in refused(capsys, "unseal", "p/m", *key)
    shutil.rmtree("p/m")
    assert "no benchmark folder here" in refused(capsys, "unseal", "p/m", *key)


def test_an_archive_that_is_missing_or_damaged(
    sealed: SealedField, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("key.txt").write_text(str(sealed.key))
    call = ("unseal", sealed.public, "--out", "u", "--key", "key.txt", "--archive")
    assert "no such archive" in refused(capsys, *call, "a.age")
    Path("a.age").write_bytes(sealed.archive.read_bytes()[:-1])
    assert "damaged, cut off" in refused(capsys, *call, "a.age")


def test_the_template_of_a_sealed_benchmark_is_checked_next(
    sealed: SealedField, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ("template", f"{NAME}-matching", "--data", sealed.public)
    assert run_main(*call) == 0
    assert (
        f"next: airzoo-bench check template.npz --data {sealed.public}" in capsys.readouterr().err
    )
