"""All that lies below a folder, also behind links."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.trees import entries_below


def test_links_are_followed_and_end(tmp_path: Path) -> None:
    tree, other = tmp_path / "tree", tmp_path / "other"
    for folder in (tree / "a", other / "deep"):
        folder.mkdir(parents=True)
        (folder / "x").touch()
    (tree / "b").symlink_to(other)
    (other / "round").symlink_to(tree)
    (tree / "again").symlink_to(other)
    (tree / "nothing").symlink_to(tmp_path / "nowhere")
    found = [one.relative_to(tree).as_posix() for one in entries_below(tree)]
    # What two links lead to is named by the first of them.
    assert found == [
        *("a", "again", "b", "nothing", "a/x", "again/deep", "again/round", "again/deep/x")
    ]
