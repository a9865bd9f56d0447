"""The pages of the board: HTML made of its JSON files alone, see docs/leaderboard-api.md.

A page holds its style, its script and its data, so that it works from disk, where browsers refuse
to load what stands beside it; its policy allows these by their hashes and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import UsageError
from airzoo_bench.leaderboard.site.drawings import history_picture
from airzoo_bench.leaderboard.site.page_compare import compare_data, pair_files
from airzoo_bench.leaderboard.site.page_front import front_view
from airzoo_bench.leaderboard.site.page_method import MethodView, method_view
from airzoo_bench.leaderboard.site.page_parts import filter_choices
from airzoo_bench.leaderboard.site.page_tables import page_tabs, table_pages
from airzoo_bench.leaderboard.site.strangers import host_of, plain_name, safe_url, shown, visible
from airzoo_bench.report.policy import content_policy

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["render_pages"]

_TABLE_SCRIPTS = ("sort.js", "filter.js", "choose.js")


def render_pages(files: Mapping[str, Any]) -> dict[str, bytes]:
    """Render the board."""
    return {path: text.encode() for path, text in _Pages(files).all()}


class _Pages:
    def __init__(self, files: Mapping[str, Any]) -> None:
        self._files = files
        self._board = files["board.json"]
        self._env = _environment()
        self._tables = {
            link["id"]: files[f"tables/{plain_name(link['id'])}/table.json"]
            for benchmark in self._board["benchmarks"]
            for link in benchmark["tables"]
        }

    def all(self) -> Iterator[tuple[str, str]]:
        """Yield each page's path and text."""
        yield from self._front()
        for table in self._tables.values():
            yield from self._of_table(table)
            yield from self._of_methods(table)

    def _front(self) -> Iterator[tuple[str, str]]:
        title = shown(self._board["title"])
        front = front_view(self._board, self._tables)
        yield self._page("index.html", "front.html", title, scripts=(), **front)
        tables = list(self._tables.values())
        for name in ("downloads", "about"):
            heading = f"{name.capitalize()} · {title}"
            yield self._page(f"{name}.html", f"{name}.html", heading, scripts=(), tables=tables)

    def _of_table(self, table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        folder, tabs = f"tables/{table['id']}", page_tabs(table, self._files)
        title = f"{shown(table['title'])} · {shown(self._board['title'])}"
        for view in table_pages(table, self._files):
            yield self._page(
                f"{folder}/{view.href}",
                "table.html",
                f"{view.heading} · {title}" if view.heading else title,
                table=table,
                tabs=tabs,
                view=view,
                asked=filter_choices(view.tables),
                downloads=_downloads(table),
            )
        if any(tab.href == "compare.html" for tab in tabs):
            data, blobs = compare_data(table, self._files)
            yield self._page(
                f"{folder}/compare.html",
                "compare.html",
                f"Compare · {title}",
                scripts=("compare.js",),
                data=data,
                blobs=blobs,
                table=table,
                tabs=tabs,
                about=_about_pairs(table, self._files),
            )

    def _of_methods(self, table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        paired = {name for _, p in pair_files(table, self._files) for name in p["ids"]}
        for row in table["rows"]:
            yield self._of_method(table, row, comparable=plain_name(row["id"]) in paired)

    def _of_method(
        self, table: Mapping[str, Any], row: Mapping[str, Any], *, comparable: bool
    ) -> tuple[str, str]:
        folder, name = f"tables/{table['id']}", plain_name(row["id"])
        found = self._files.get(f"{folder}/methods/{name}.json")
        view: MethodView = method_view(table, row, found, self._board["data_url"])
        return self._page(
            f"{folder}/methods/{name}.html",
            "method.html",
            f"{view.name} · {shown(table['title'])} · {shown(self._board['title'])}",
            scripts=("copy.js",) if view.bibtex else (),
            table=table,
            id=name,
            comparable=comparable,
            view=view,
            chart=history_picture(view.points) if len(view.points) > 1 else "",
        )

    def _page(
        self,
        path: str,
        template: str,
        title: str,
        *,
        scripts: Sequence[str] = _TABLE_SCRIPTS,
        data: str = "",
        blobs: Sequence[str] = (),
        **values: Any,
    ) -> tuple[str, str]:
        script = _script(scripts)
        page = {
            "policy": content_policy(script, _read("style.css")),
            "style": _read("style.css"),
            "script": script,
            "data": data,
            "blobs": blobs,
        }
        text = self._env.get_template(template).render(
            page=page,
            root="../" * path.count("/"),
            here=path,
            title=title,
            board=self._board,
            **values,
        )
        return path, text


def _about_pairs(table: Mapping[str, Any], files: Mapping[str, Any]) -> str:
    return " ".join(dict.fromkeys(shown(p["about"], 1000) for _, p in pair_files(table, files)))


def _downloads(table: Mapping[str, Any]) -> list[tuple[str, str]]:
    named = [("CSV", "csv"), ("JSON", "json"), ("LaTeX", "latex"), ("Markdown", "markdown")]
    found = [(text, table["links"][key]) for text, key in named]
    return [*found, ("all data (JSON)", f"api/v1/tables/{table['id']}/table.json")]


def _environment() -> Environment:
    try:
        import jinja2
    except ImportError as error:
        raise UsageError(
            "the pages of a board are made by Jinja, which is not installed",
            fix="pip install 'airzoo-bench[leaderboard]'",
        ) from error
    env = jinja2.Environment(
        loader=jinja2.FunctionLoader(_read),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=visible,  # whatever a template forgot to have cleaned
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {"shown": shown, "safe_url": safe_url, "host": host_of}
    env.globals["downloads_of"] = _downloads
    return env


_FOLDER = resources.files("airzoo_bench.leaderboard.site") / "html"
_TEXTS: dict[str, str] = {}


def _read(name: str) -> str:
    if name not in _TEXTS:
        _TEXTS[name] = (_FOLDER / name).read_text(encoding="utf-8")
    return _TEXTS[name]


def _script(names: Sequence[str]) -> str:
    if not names:
        return ""
    return '(function () {\n"use strict";\n' + "\n".join(map(_read, names)) + "})();\n"
