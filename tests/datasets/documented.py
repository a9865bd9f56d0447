"""The parts of the docs that are made from what datasets say; run this to write them anew.

python -m tests.datasets.documented
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import Protocol

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "docs" / "benchmarks.md"


def benchmarks() -> dict[str, str]:
    """Return the parts of docs/benchmarks.md, by their markers."""
    datasets = {name: DATASETS.get(name) for name in DATASETS.names()}
    described = {name: one for name, one in datasets.items() if one.about.assumptions}
    published = {name: one for name, one in datasets.items() if one.about.is_published}
    described |= published
    rows = "".join(overview_row(name, one) for name, one in published.items())
    title = "| benchmark | track | scenes | queries | protocol |\n| --- | --- | --- | --- | --- |\n"
    about = {f"about {name}": about_lines(one) for name, one in described.items()}
    return {"overview": f"\n{title}{rows}\n", **about}


def protocols_of(name: str) -> list[Protocol]:
    """Return the shipped protocols of a benchmark."""
    every = (load_protocol(path) for path in shipped_protocols().values())
    return [protocol for protocol in every if protocol.benchmark == name]


def overview_row(name: str, dataset: Any) -> str:
    """Return the rows of a benchmark, one for each of its protocols."""
    rows = []
    for number, protocol in enumerate(protocols_of(name)):
        counts = [scene.queries for scene in protocol.scenes if scene.queries is not None]
        title = dataset.about.title if number == 0 else ""
        queries = f"{sum(counts):,}" if counts else ""
        rows.append(
            f"| {title} | {protocol.track} | {len(protocol.scenes)} | {queries} "
            f"| {protocol.name} |\n"
        )
    return "".join(rows)


def about_lines(dataset: Any) -> str:
    """Return what a dataset says of itself, as lists."""
    about = dataset.about
    where = [f"<{about.page}>"] * bool(about.page)
    if about.repository:
        where.append(f"`airzoo-bench download {about.example.split()[0]}`")
    lines = [f"- Where: {', '.join(where)}"] * bool(where)
    lines += [f"- Licence: {about.licence}"] * bool(about.licence)
    lines.append(f"- Command: `airzoo-bench prepare {about.example}`")
    for title, sentences in (("Assumed", about.assumptions), ("Not verified", about.unverified)):
        if sentences:
            lines += [f"- {title}:", *(f"  - {sentence}" for sentence in sentences)]
    return "\n" + "\n".join(lines) + "\n\n"


def parts(page: str, name: str) -> tuple[str, str, str]:
    """Split a page into what stands before, in and after a list."""
    marker = f"<!-- {name}: made by tests/datasets/documented.py -->\n"
    before, rest = page.split(marker)
    inside, after = rest.split("<!-- end -->", 1)
    return before + marker, inside, "<!-- end -->" + after


def main() -> None:
    """Write the parts anew."""
    for name, made in benchmarks().items():
        page = BENCHMARKS.read_text(encoding="utf-8")
        before, _, after = parts(page, name)
        BENCHMARKS.write_text(before + made + after, encoding="utf-8")


if __name__ == "__main__":
    main()
