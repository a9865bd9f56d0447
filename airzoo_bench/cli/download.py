"""``airzoo-bench download``: published benchmarks as they are published."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import examples, put, say
from airzoo_bench.core.errors import UsageError, counted, sized
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About, about_file, read_about

EXAMPLES = examples("download NAME", "download NAME --to /data/NAME --scene 01 --yes")


def download(
    benchmark: Annotated[str, typer.Argument(help="As `prepare` names it.", show_default=False)],
    to: Annotated[
        Path | None,
        typer.Option("--to", help="Folder to put it in (default: its name).", show_default=False),
    ] = None,
    scene: Annotated[
        list[str] | None,
        typer.Option(help="Only this scene of airzoo-real, repeatable; others are fetched whole."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing.")] = False,
) -> None:
    """Fetch a published benchmark from Hugging Face, or list the links to its files.

    Run it again to go on after an interruption; files that are there and whole are not fetched
    again.
    """
    about, folder = _about(benchmark), to or Path(benchmark)
    _check_scenes(about, scene or [])
    say(f"{about.title}, licence: {about.licence}")
    if about.repository is None:
        _list_links(benchmark, about)
        return
    from airzoo_bench.datasets.downloads import HubDataset, others_patterns

    left_out = others_patterns(about.scene_files, scene or [])
    source = HubDataset(about.repository, left_out, folder)
    sizes = source.sizes()
    say(f"{counted(len(sizes), 'file')} to fetch, {sized(sum(sizes))}")
    if sizes and not yes and sys.stdin.isatty():
        typer.confirm("Go on?", default=True, abort=True, err=True)
    source.fetch()
    put(f"{folder}\n")
    say(f"next: airzoo-bench prepare {benchmark} --source {folder}")


def _about(benchmark: str) -> About:
    files = {name: about_file(name) for name in DATASETS.names()}
    offered: dict[str, About] = {
        name: read_about(file) if file.is_file() else DATASETS.get(name).about
        for name, file in files.items()
    }
    published = {name: about for name, about in offered.items() if about.is_published}
    if benchmark not in published:
        from airzoo_bench.core.validation import nearest

        raise UsageError(
            f"there is no published benchmark {benchmark[:80]!r}"
            + nearest(benchmark[:80], list(published), 1),
            expected=", ".join(published) or "none is known yet",
        )
    return published[benchmark]


def _check_scenes(about: About, scenes: Sequence[str]) -> None:
    """Refuse scenes that cannot be fetched by themselves, before anything is asked for."""
    known = about.scene_files
    unknown = [scene for scene in scenes if scene not in known]
    if unknown:
        raise UsageError(
            f"scene {unknown[0]!r} cannot be fetched by itself",
            where="--scene",
            expected=f"some of {', '.join(known) or 'none: it can only be fetched whole'}",
            fix="leave --scene out, and name scenes at `prepare`",
        )


def _list_links(benchmark: str, about: About) -> None:
    """Print the links, one a line, and say what to do with them."""
    put("".join(f"{link}\n" for link in about.links or (about.page,)))
    how = "in a browser or with wget -c" if about.links else "as the page says"
    say(f"{about.title} is not on Hugging Face: fetch it by hand, {how}")
    say(f"next: unpack it, then: airzoo-bench prepare {benchmark} --source FOLDER")
