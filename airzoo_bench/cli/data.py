"""``airzoo-bench download``, ``manifest`` and ``protocols``: benchmarks and their data."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, put, say, show_rows
from airzoo_bench.cli.locations import DataOption, resolve_data
from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About, about_file, about_of

if TYPE_CHECKING:
    from airzoo_bench.protocol.model import Protocol

_TITLES = (
    *("Protocol", "Track", "Scenes", "Queries"),
    *("Version", "Fingerprint", "Title", "Data", "Licence", "Assumed"),
)


def download(
    benchmark: Annotated[str, typer.Argument(help="Its name in `prepare`.")],
    to: Annotated[
        Path | None, typer.Option("--to", help="Folder to put it in (default: its name).")
    ] = None,
    scene: Annotated[
        list[str] | None,
        typer.Option(help="Only this scene of airzoo-real, repeatable; others are fetched whole."),
    ] = None,
) -> None:
    """Fetch a published benchmark from Hugging Face, or list the links to its files.

    Run it again after an interruption: files that are there and whole are not fetched
    again.
    """
    offered = {name: about for name in DATASETS.names() if (about := _about(name)) is not None}
    published = {name: about for name, about in offered.items() if about.is_published}
    if benchmark not in published:
        from airzoo_bench.core.validation import nearest

        near = nearest(benchmark[:80], list(published), 1)
        what = f"there is no published benchmark {benchmark[:80]!r}{near}"
        raise UsageError(what, expected=", ".join(published))
    about, folder = published[benchmark], to or Path(benchmark)
    if unknown := [one for one in scene or () if one not in about.scene_files]:
        raise UsageError(
            f"scene {unknown[0]!r} cannot be fetched by itself",
            where="--scene",
            expected=", ".join(about.scene_files) or "none: it can only be fetched whole",
            fix="leave --scene out, and name scenes at `prepare`",
        )
    say(f"{about.title}, licence: {about.licence}")
    if about.repository is None:
        put("".join(f"{link}\n" for link in about.links or (about.page,)))
        how = "in a browser or with wget -c" if about.links else "as the page says"
        say(f"{about.title} is not on Hugging Face: fetch it by hand, {how}")
        say(f"next: unpack it, then: airzoo-bench prepare {benchmark} --source FOLDER")
        return
    from airzoo_bench.datasets.downloads import HubDataset, others_patterns

    left_out = others_patterns(about.scene_files, scene or [])
    source = HubDataset(about.repository, left_out, folder)
    sizes = source.sizes()
    say(f"{counted(len(sizes), 'file')} to fetch, {sum(sizes) / 1e6:,.3g} MB")
    if sizes and sys.stdin.isatty():
        typer.confirm("Go on?", default=True, abort=True, err=True)
    source.fetch()
    put(f"{folder}\n")
    say(f"next: airzoo-bench prepare {benchmark} --source {folder}")


def manifest(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with benchmark.toml.")],
    force: Annotated[
        bool, typer.Option("--force", help="Replace checksums that differ from the files.")
    ] = False,
) -> None:
    """Fill in benchmark.toml of a folder made by hand: its checksums, and what else is missing.

    docs/benchmark-folder.md says which files and columns there are.
    """
    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.datasets.handmade import complete_manifest

    written = complete_manifest(folder, replace=force)
    Benchmark.open(folder)
    put(f"{folder}\n")
    for sentence in written:
        say(f"written: {sentence}")


def protocols(
    name: Annotated[str | None, typer.Argument(help="Print this protocol's file.")] = None,
    data: DataOption = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """List the protocols of the package and of prepared benchmark folders.

    With a name, print its file, and licence and assumptions of the benchmark.
    """
    from airzoo_bench.protocol.model import find_protocol, load_protocol, protocol_files

    folder = resolve_data(data)
    if name is not None:
        protocol = find_protocol(name, folder)
        path = Path(name) if name.endswith(".toml") else protocol_files(folder)[name]
        put(_about_lines(protocol.benchmark) + path.read_text(encoding="utf-8"))
        return
    rows = [_values(key, load_protocol(path)) for key, path in protocol_files(folder).items()]
    few = 4 if form is Format.TERMINAL else None
    if few:
        say("protocols NAME prints one and what is assumed of its data; --format json has all")
    show_rows("Protocols", _TITLES[:few], [row[:few] for row in rows], form)


def _values(key: str, protocol: Protocol) -> tuple[str | int, ...]:
    # Published counts are of the whole benchmark, not of what a folder holds of it.
    partial = protocol.benchmark.endswith("-partial")
    counts = [s.queries for s in protocol.scenes if s.queries is not None and not partial]
    queries = sum(counts) if len(counts) == len(protocol.scenes) else ""
    first = (key, protocol.track, len(protocol.scenes), queries)
    about = _about(protocol.benchmark)
    data = (about.page, about.licence, " ".join(about.assumptions)) if about else ("", "", "")
    return (*first, protocol.version, protocol.fingerprint[:12], protocol.title, *data)


def _about(benchmark: str) -> About | None:
    """Return what is known of a benchmark's data, where a dataset of that name says it."""
    name = benchmark.removesuffix("-partial")
    if about_file(name).is_file():
        return about_of(name)
    found: About | None = DATASETS.get(name).about if name in DATASETS else None
    return found


def _about_lines(benchmark: str) -> str:
    """Return what is known of the data as comments, so that the whole is still a protocol file."""
    about = _about(benchmark)
    if about is None:
        return ""
    lines = [f"{about.title}: {about.page}", f"licence: {about.licence}"]
    lines += [f"assumed: {sentence}" for sentence in about.assumptions]
    lines += [f"not verified: {sentence}" for sentence in about.unverified]
    return "".join(f"# {line}\n" for line in lines)
