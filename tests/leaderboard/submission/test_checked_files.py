"""Where a submission lies, and which files it may have."""

from __future__ import annotations

import datetime
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.leaderboard.submission.support import checked, only_error, write, write_board


class TestPlace:
    def test_a_benchmark_that_the_board_has_not(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        home = write(board, perfect)
        moved = board / "submissions" / "mad" / "retrieval" / "salad"
        moved.parent.mkdir(parents=True)
        shutil.move(home, moved)
        assert "no place for a submission (did you mean 'made'?)" in only_error(
            checked(moved, data)
        )

    def test_another_track(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        moved = board / "submissions" / "made" / "matching" / "salad"
        moved.parent.mkdir(parents=True)
        shutil.move(home, moved)
        message = only_error(checked(moved, data))
        assert "the folder is of matching of made" in message
        assert "submissions/made/retrieval" in message

    def test_a_protocol_that_the_board_has_not(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect, protocol="airzoo-mini-retrieval")
        assert "by which this board does not score made" in only_error(checked(home, data))

    def test_a_protocol_is_never_a_path(
        self, board: Path, data: Path, perfect: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        (tmp_path / "own.toml").write_text("x", encoding="utf-8")
        home = write(board, perfect, protocol="own.toml")
        assert "by which this board does not score made" in only_error(checked(home, data))


class TestFiles:
    def test_a_link(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        (home / "names.txt").symlink_to("/etc/passwd")
        assert "a link, a pipe or a device" in only_error(checked(home, data))

    def test_a_pipe(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        os.mkfifo(home / "pipe")
        assert "a link, a pipe or a device" in only_error(checked(home, data))

    def test_what_nobody_speaks_of(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        (home / "conftest.py").write_text("", encoding="utf-8")
        assert "1 entry (conftest.py)" in only_error(checked(home, data))

    @pytest.mark.parametrize(
        ("name", "said"),
        [
            ("my scene.npz", "the name has blanks"),
            (".hidden", "the name begins with a dot"),
            ("aux.npz", "the name is none on Windows"),
            ("p.", "the name is none on Windows"),
            ("\xe4.npz", "other characters than those of plain names"),
        ],
    )
    def test_names_that_ci_refuses(
        self, board: Path, data: Path, perfect: Any, name: str, said: str
    ) -> None:
        home = write(board, perfect)
        (home / name).write_bytes(b"")
        assert said in only_error(checked(home, data))

    def test_what_follows_a_line_break_in_a_name_is_no_message(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        home = write(board, perfect)
        (home / "x\nsalad: nothing wrong was found").write_bytes(b"")
        assert "\nsalad" not in only_error(checked(home, data))

    def test_modes_depths_and_twins_that_ci_refuses(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        home = write(board, perfect)
        (home / "PREDS.npz").write_bytes(b"")
        assert "differs from another name only in case" in only_error(checked(home, data))
        (home / "PREDS.npz").unlink()
        deep = home.joinpath(*"abcdefgh")
        deep.mkdir(parents=True)
        (deep / "x").touch()
        assert "lies in more than 12 folders" in only_error(checked(home, data))
        shutil.rmtree(home / "a")
        (home / "preds.npz").chmod(0o755)
        assert "is an executable file" in only_error(checked(home, data))

    def test_folder_that_windows_takes_for_a_device(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        assert "no place for a submission" in only_error(
            checked(write(board, perfect, folder="nul"), data)
        )

    def test_claim_of_a_million_keys_is_not_read(
        self, board: Path, data: Path, perfect: Any
    ) -> None:
        home = write(board, perfect)
        keys = (f'"{number:06}": 1' for number in range(400_000))
        (home / "result.json").write_text(f"{{{', '.join(keys)}}}", encoding="utf-8")
        assert "more than a result of this suite takes" in only_error(checked(home, data))

    def test_a_date_that_is_to_come(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect, date=datetime.date(9999, 12, 31))
        assert "key 'date' is 9999-12-31, which is to come" in only_error(checked(home, data))

    def test_too_many(
        self, board: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("airzoo_bench.leaderboard.checks.MOST_FILES", 1)
        assert "more than 1 files and folders" in only_error(checked(write(board, perfect), data))

    def test_too_large(self, board: Path, data: Path, perfect: Any) -> None:
        write_board(board, "[limits]\ncommitted_bytes = 1000\n")
        message = only_error(checked(write(board, perfect), data))
        assert "at most 1,000 bytes" in message
        assert "--url" in message

    def test_other_bytes_than_announced(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        file = home / "preds.npz"
        content = bytearray(file.read_bytes())
        content[-1] ^= 1
        file.write_bytes(bytes(content))
        assert "key 'predictions.sha256' is" in only_error(checked(home, data))
        file.write_bytes(bytes(content) + b"x")
        assert "key 'predictions.bytes' is" in only_error(checked(home, data))

    def test_a_file_that_is_not_there(self, board: Path, data: Path, perfect: Any) -> None:
        home = write(board, perfect)
        (home / "preds.npz").unlink()
        assert "key 'predictions.file' is 'preds.npz', which is not there" in only_error(
            checked(home, data)
        )

    def test_no_submission_file(self, board: Path, data: Path) -> None:
        home = board / "submissions" / "made" / "retrieval" / "salad"
        home.mkdir(parents=True)
        assert "no such submission file" in only_error(checked(home, data))
