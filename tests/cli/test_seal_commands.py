"""``seal`` and ``seal-score``: one message for each fault, exit code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.leaderboard.sealing import KEY_VARIABLE, load_pyrage
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


def score(public: Path, archive: Path, *more: object) -> tuple[object, ...]:
    """Write answers, and return the command that scores them."""
    assert run_main("template", f"{NAME}-retrieval", "--data", public, "--out", "t.npz") == 0
    where = ("--protocol", f"{NAME}-retrieval", "--data", public, "--archive", archive)
    return "seal-score", "t.npz", *where, *more


def test_the_key_of_the_environment(sealed: SealedField, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, f"# a comment\n{sealed.key}\n")
    assert run_main(*score(sealed.public, sealed.archive)) == 0


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
    call = score(sealed.public, sealed.archive, "--key", "key.txt")
    capsys.readouterr()
    said = refused(capsys, *call)
    assert expected in said
    assert str(sealed.key)[20:40] not in said


def test_no_key_and_no_file_of_one(sealed: SealedField, capsys: pytest.CaptureFixture[str]) -> None:
    call = score(sealed.public, sealed.archive)
    capsys.readouterr()
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
    Path("key.txt").write_text(str(sealed.key))
    call = score(Path("p/m"), Path("p/a.age"), "--key", "key.txt")
    capsys.readouterr()
    assert "another key" in refused(capsys, *call)
    whole = [sealed.folder if part == Path("p/m") else part for part in call]
    assert "is not sealed" in refused(capsys, *whole)


def test_the_template_of_a_sealed_benchmark_is_checked_next(
    sealed: SealedField, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ("template", f"{NAME}-matching", "--data", sealed.public)
    assert run_main(*call) == 0
    assert (
        f"next: airzoo-bench check template.npz --data {sealed.public}" in capsys.readouterr().err
    )
