"""The pictures of results, a function a kind, and what they are drawn of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest
from airzoo_bench.report.figures import Sheet
from airzoo_bench.report.matching import draw_arrows, draw_matches
from airzoo_bench.report.places import draw_hits, draw_tiles, find_places
from airzoo_bench.report.plots import condition, errors, intervals, recall, scenes, thresholds
from airzoo_bench.report.reconstruction import draw_clouds
from airzoo_bench.report.sections import read_sections
from airzoo_bench.results.comparable import check_same_queries, choose_scores, find_scene
from airzoo_bench.results.records import Scored, read_scored
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_KINDS: dict[str, Any] = {
    "condition": condition,
    "errors": errors,
    "intervals": intervals,
    "recall": recall,
    "scenes": scenes,
    "thresholds": thresholds,
}
OF_ONE_RUN = ("map", "query", "cloud")


def choose_score(
    methods: Sequence[Scored], wanted: str | None, *, of_errors: bool = False
) -> ScoreColumn:
    """Return the score that was named, else the first headline one, or the first error."""
    named = wanted is not None or not of_errors
    found = choose_scores(methods, [wanted] if wanted else [], every=not named)
    errors = [score for score in found if score.unit != "share"]
    if of_errors and not errors:
        expected = "a score in m or degrees"
        raise UsageError(f"{found[0].title} is no error", expected=expected)
    return errors[0] if of_errors else found[0]


def restrict_to_scene(methods: Sequence[Scored], wanted: str) -> list[Scored]:
    """Return the methods restricted to one scene, named by id or title."""
    titles = methods[0].result.truth.scene_titles
    scene = find_scene(titles, wanted)
    found = []
    for method in methods:
        values, truth = method.result.scenes[scene], method.result.truth
        changes = {
            "scenes": {scene: values},
            "overall": values,
            "truth": truth.model_copy(update={"scene_titles": {scene: titles[scene]}}),
        }
        records = method.records[method.records["scene"] == scene].reset_index(drop=True)
        found.append(Scored(method.name, method.result.model_copy(update=changes), records))
    return found


def picture(
    kind: str,
    paths: Sequence[Path],
    sheet: Sheet,
    *,
    score: str | None = None,
    scene: str | None = None,
    **more: Any,
) -> Figure:
    """Draw a kind of picture as ``airzoo-bench plot`` does."""
    if kind in OF_ONE_RUN:
        return draw_run(kind, paths, scene, sheet, **more)
    methods = read_scored(paths)
    check_same_queries(methods)
    if scene is not None:
        methods = restrict_to_scene(methods, scene)
    chosen = choose_score(methods, score, of_errors=kind == "errors")
    scores = [] if kind in ("recall", "thresholds") else [chosen]
    figure: Figure = _KINDS[kind](methods, *scores, sheet=sheet, **more)
    return figure


def draw_run(
    kind: str,
    paths: Sequence[Path],
    scene: str | None = None,
    sheet: Sheet | None = None,
    *,
    data: Path | None = None,
    query: str = "",
) -> Figure:
    """Draw a scene's ``map``, a ``query`` or a scene's ``cloud`` of a single run."""
    section = read_sections(paths)[0]
    if len(paths) > 1 or (kind == "cloud") == section.by_query:
        expected = "one result of " + (
            "reconstruction" if kind == "cloud" else "retrieval or matching"
        )
        raise UsageError(f"plot {kind} draws a single run of its track", expected=expected)
    titles, matching = section.first.truth.scene_titles, section.track == "matching"
    wanted = next(iter(titles)) if scene is None else find_scene(titles, scene)
    if kind == "cloud":
        return draw_clouds(section, wanted, sheet)
    places = find_places(section, Path() if data is None else data)
    if kind == "map":
        place = next(place for place in places if place.scene == wanted)
        return (draw_arrows if matching else draw_hits)(section, place, sheet)
    known = {name: place for place in places for name in place.photos}
    if query not in known:
        raise UsageError(f"--query {query}: there is no such query{nearest(query, [*known])}")
    return (draw_matches if matching else draw_tiles)(section, known[query], query, sheet)
