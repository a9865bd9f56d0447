"""The options of ``airzoo-bench table``, and whether they fit together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.results.result import Result

__all__ = ["Layout", "TableRequest", "layout_named"]


class Layout(StrEnum):
    """How results are laid out."""

    RESULT = "result"
    METHODS = "methods"
    SCENES = "scenes"
    BENCHMARKS = "benchmarks"


def layout_named(text: str) -> Layout:
    """Return the layout of a name.

    Raises
    ------
    UsageError
        There is none.
    """
    from airzoo_bench.core.validation import nearest

    names = list(Layout)
    if text not in names:
        raise UsageError(
            f"there is no layout {text[:80]!r}{nearest(text[:80], [*map(str, names)])}",
            where="--layout",
            expected="one of " + ", ".join(names),
        )
    return Layout(text)


@dataclass(frozen=True)
class TableRequest:
    """The options of the command that change the table's content; see there."""

    results: tuple[Path, ...]
    protocol: str | None = None
    layout: Layout | None = None
    scene: str | None = None
    every_score: bool = False
    scores: tuple[str, ...] = ()
    published: bool = False
    second: bool = False
    baselines: tuple[str, ...] = ()
    highlighted: tuple[str, ...] = ()
    citations: tuple[str, ...] = ()
    intervals: bool = False
    queries: bool = False
    average: bool = True
    renamed: tuple[str, ...] = ()
    floors: bool = False
    sort: str | None = None
    decimals: int | None = None

    def checked_layout(self, results: Sequence[Result]) -> Layout:
        """Return the layout, as asked for or by default, and check all options against it.

        Parameters
        ----------
        results : sequence of Result
            Those of the files; none where only published numbers are asked for.

        Raises
        ------
        UsageError
            Options do not fit together.
        """
        if not self.results or self.protocol is not None:
            return self._layout_of_published()
        layout = self.layout or self._usual_layout(results)
        self._check(layout, results)
        return layout

    def _layout_of_published(self) -> Layout:
        if self.results or self.protocol is None or not self.published:
            raise UsageError(
                "results name their own protocol" if self.results else "nothing to lay out",
                expected="result files, or --published with --protocol and no results",
                fix="such as `airzoo-bench table --published --protocol uav-visloc-retrieval`",
            )
        needing = {
            "--intervals": self.intervals,
            "--floors": self.floors,
        }
        for name, given in needing.items():
            if given:
                raise UsageError(f"{name} needs results", fix="leave it out, or name results")
        layout = self.layout or Layout.METHODS
        self._check(layout, ())
        if layout not in (Layout.METHODS, Layout.SCENES):
            raise UsageError(
                f"layout {layout} is for results", fix="choose --layout methods or scenes"
            )
        return layout

    def _usual_layout(self, results: Sequence[Result]) -> Layout:
        if len({result.protocol.name for result in results}) > 1:
            return Layout.BENCHMARKS
        # One result has nothing to be compared with, unless reported rows are asked for.
        by_method = len(results) > 1 or self.published or self.scene is not None
        return Layout.METHODS if by_method else Layout.RESULT

    def _check(self, layout: Layout, results: Sequence[Result]) -> None:
        from airzoo_bench.results.comparable import first_names

        if layout is Layout.RESULT:
            self._check_alone()
        names = dict.fromkeys(result.protocol.name for result in results)
        if layout in (Layout.METHODS, Layout.SCENES) and len(names) > 1:
            raise UsageError(
                f"layout {layout} is for results of one protocol, and these are of {len(names)}: "
                + first_names(list(names)),
                fix="choose --layout benchmarks, or name results of one protocol only",
            )
        wrong = {
            "--scene": bool(self.scene) and layout is not Layout.METHODS,
            "--queries": self.queries and layout is not Layout.SCENES,
            "--no-average": not self.average and layout is not Layout.SCENES,
        }
        for name, is_wrong in wrong.items():
            if is_wrong:
                raise UsageError(
                    f"{name} does not go with layout {layout}: it needs another layout"
                )

    def _check_alone(self) -> None:
        if len(self.results) > 1:
            raise UsageError(
                f"layout result shows one result, and here are {len(self.results)} results",
                fix="choose --layout methods, scenes or benchmarks",
            )
        compared = {
            "--second": self.second,
            "--baseline": self.baselines,
            "--published": self.published,
        }
        of_methods = {
            "--scene": self.scene,
            "--highlight": self.highlighted,
            "--cite": self.citations,
            "--sort": self.sort,
        }
        _refuse_alone(compared, "nothing to be compared with", "name more results")
        _refuse_alone(of_methods, "scenes for rows", "add --layout methods")


def _refuse_alone(given: Mapping[str, object], why: str, fix: str) -> None:
    odd = [name for name, value in given.items() if value]
    if odd:
        raise UsageError(
            f"layout result, of one result, has {why}, and takes no {' and '.join(odd)}", fix=fix
        )
