"""What the bundles of platforms share: protocol and truth, pages, a picture, archives."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.exports.phases import Phase
from airzoo_bench.leaderboard.exports.reference import write_reference
from airzoo_bench.leaderboard.exports.settings import (
    SETTINGS_FILE,
    WORST,
    ScoringSettings,
    scoring_settings,
)
from airzoo_bench.leaderboard.exports.templates import rendered
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol

__all__ = ["Competition", "logo", "open_competition", "write_archive"]

_NO_TIME = (1980, 1, 1, 0, 0, 0)
_LOGO_SIDE, _LOGO_STEP = 256, 32


@dataclass(frozen=True, eq=False)
class Competition:
    """A protocol on a platform.

    Attributes
    ----------
    per_day, in_all : int
        Submissions that a participant may make in a phase.
    """

    benchmark: Benchmark
    protocol: Protocol
    settings: ScoringSettings
    phases: list[Phase]
    per_day: int
    in_all: int

    @property
    def values(self) -> dict[str, object]:
        """What templates are filled with."""
        return {
            "title": self.protocol.title,
            "summary": self.protocol.summary.strip(),
            "protocol": self.protocol,
            "columns": self.settings.columns,
            "sealed": self.settings.sealed,
            "phases": self.phases,
            "per_day": self.per_day,
            "in_all": self.in_all,
            "version": __version__,
            "worst": WORST,
        }

    def write_scoring(self, program: Path, reference: Path) -> None:
        """Write what the scoring program reads: its settings, and the truth."""
        program.mkdir(parents=True)
        text = self.settings.model_dump_json(by_alias=True, indent=1) + "\n"
        (program / SETTINGS_FILE).write_text(text, encoding="utf-8")
        reference.mkdir(parents=True)
        write_reference(self.benchmark, self.protocol, reference)

    def write_texts(self, folder: Path, texts: Iterable[tuple[str, str]], **more: object) -> None:
        """Write files, each of its template."""
        for name, template in texts:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(rendered(template, **self.values, **more), encoding="utf-8")


def open_competition(
    protocol: str, data: Path, phases: list[Phase], *, sealed: bool, per_day: int, in_all: int
) -> Competition:
    """Find a protocol and its benchmark.

    Raises
    ------
    UserError
        There is no such protocol, or no benchmark folder that fits it.
    """
    if in_all < per_day:
        raise UsageError(
            f"{in_all} submissions in all are fewer than {per_day} a day",
            fix="raise --in-all, or lower --per-day",
        )
    chosen = find_protocol(protocol, data)
    benchmark = find_benchmark(chosen.benchmark, data)
    benchmark.check_fits(chosen)
    settings = scoring_settings(chosen, sealed=sealed)
    return Competition(benchmark, chosen, settings, phases, per_day, in_all)


def logo() -> bytes:
    """Draw the picture that platforms ask for: a map's grid with one tile found."""
    from PIL import Image, ImageDraw

    picture = Image.new("RGB", (_LOGO_SIDE, _LOGO_SIDE), "#1f4e5f")
    draw = ImageDraw.Draw(picture)
    for place in range(0, _LOGO_SIDE, _LOGO_STEP):
        draw.line([(place, 0), (place, _LOGO_SIDE)], "#5d8a98")
        draw.line([(0, place), (_LOGO_SIDE, place)], "#5d8a98")
    draw.rectangle([4 * _LOGO_STEP, 2 * _LOGO_STEP, 6 * _LOGO_STEP, 4 * _LOGO_STEP], "#f2b134")
    content = io.BytesIO()
    picture.save(content, "PNG")
    return content.getvalue()


def write_archive(path: Path, folder: Path) -> None:
    """Write all files of a folder as a zip that is the same bytes for the same files."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            member = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _NO_TIME)
            member.compress_type = zipfile.ZIP_DEFLATED
            member.external_attr = 0o644 << 16
            with file.open("rb") as source, archive.open(member, "w", force_zip64=True) as target:
                while chunk := source.read(1 << 20):
                    target.write(chunk)
